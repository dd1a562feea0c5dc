"""The example of docs/bodies.md runs and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

PAGE = Path(__file__).resolve().parents[2] / "docs" / "bodies.md"


def test_the_example_of_the_page_runs() -> None:
    (example,) = re.findall(
        r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    names: dict[str, object] = {}
    exec(compile(example, str(PAGE), "exec"), names)
    state = names["state"]
    speed = -12.0 - 9.81 / 240.0
    np.testing.assert_allclose(state.velocity, [0.0, 0.0, speed])  # type: ignore[attr-defined]
    np.testing.assert_allclose(state.position, [0.5, 0.5, 0.5 + speed / 240.0])  # type: ignore[attr-defined]


def test_every_public_shape_is_on_the_page() -> None:
    from barchan.bodies import rigid

    text = PAGE.read_text(encoding="utf-8")
    shapes = [
        name
        for name in rigid.__all__
        if isinstance(getattr(rigid, name), type) and issubclass(getattr(rigid, name), rigid.Shape)
    ]
    assert [name for name in shapes if name != "Shape" and f"{name}" not in text] == []
