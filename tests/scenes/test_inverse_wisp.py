"""Scenes of fibres with [inverse]: a groom stays where it is with the natural shapes that are found, and sags without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.errors import InputError

SMALL: dict[str, Any] = {
    "fibres.count": 5, "fibres.segments": 3, "roots.motion": "still", "time.step": 0.02, "time.end": 0.5,
    "inverse.settle": 3.0, "solver.tolerance": 1e-7,
}  # fmt: skip


@pytest.mark.parametrize("target", ["straight", "unaware"])
def test_a_groom_stays_only_with_its_natural_shape(target: str) -> None:
    model = scenes.load("inverse_wisp", **SMALL, **{"inverse.target": target}).model()
    state = model.initial()
    start = model.fibres.centre_line(state.shape)
    speeds = []
    for _ in range(25):
        state, record = model.advance(state, 0.02)
        speeds.append(record.max_speed)
    moved = np.max(np.abs(model.fibres.centre_line(state.shape) - start))
    if target == "straight":
        assert speeds[-1] < 1e-6 and moved < 1e-5
    else:
        assert max(speeds) > 1e-2 and moved > 5e-4


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("fibres.model", {"fibres.model": "rods"}),
        ("inverse.settle", {"inverse.settle": 0.04}),
        ("inverse.target", {"inverse.target": "curly"}),
        ("inverse.regularisation", {"inverse.regularisation": -1.0}),
    ],
)
def test_what_cannot_be_groomed_is_refused(field: str, change: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        scenes.load("inverse_wisp", **{**SMALL, **change}).model()
    assert field in str(caught.value)
