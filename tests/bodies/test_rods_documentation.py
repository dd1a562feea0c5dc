"""The example of docs/fibres.md on Discrete Elastic Rods runs and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from barchan.bodies.fibres import rods, roots

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "fibres.md").read_text(encoding="utf-8")


def test_the_curl_of_the_example_hangs_at_rest() -> None:
    section = PAGE.split("## Discrete Elastic Rods")[1].split("\n## ")[0]
    (example,) = re.findall(r"^```python\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, "fibres.md", "exec"), names)
    rest, nodes = names["rest"], names["nodes"]
    assert isinstance(rest, rods.Rest)
    assert isinstance(nodes, np.ndarray)
    assert rest.converged and rest.shape.nodes[-1, 2] < nodes[-1, 2]


def test_what_people_call_is_on_the_page() -> None:
    names = [name for name in rods.__all__ if name not in ("Rest", "RodShape")]
    names += ["StillRoots", "MovingRoots", "frames_along"]
    assert all(hasattr(rods, name) or hasattr(roots, name) for name in names)
    assert [name for name in names if name not in PAGE] == []
