"""The skirt of `inverse_skirt` stays where it was drawn, and falls without the rest shape found for it (seed B, Fig. 4.12)."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.scenes import load
from barchan.scenes.kinds.cloth.model import ClothModel

COARSE = {"cloth.spacing": 0.07, "time.step": 0.01}
STEPS = 20


def moved(rest_shape: bool) -> tuple[np.ndarray, float]:
    """(n, 3) displacements after 0.2 s, and the largest speed then."""
    model = ClothModel(load("inverse_skirt", **COARSE, **{"inverse.rest_shape": rest_shape}).parameters)
    state = model.initial()
    start = state.positions
    for _ in range(STEPS):
        state, record = model.advance(state, 0.01)
        assert record.converged
    return state.positions - start, float(np.abs(state.velocities).max())


def test_the_skirt_stays_on_the_hips_with_the_rest_shape_that_was_found() -> None:
    displacement, speed = moved(True)
    assert np.abs(displacement).max() < 1e-5 and speed < 1e-5


def test_the_skirt_falls_with_the_drawn_shape_as_its_rest_shape() -> None:
    displacement, _ = moved(False)
    assert displacement[:, 2].max() < -0.05


@pytest.mark.parametrize(
    ("key", "value"),
    [("friction_share", 0.0), ("iterations", 0), ("imbalance", 0.0), ("regularisation", -1.0)],
)
def test_unusable_tables_are_refused(key: str, value: float) -> None:
    with pytest.raises(InputError, match=f"inverse.{key}"):
        load("inverse_skirt", **{f"inverse.{key}": value})


def test_a_start_that_nothing_keeps_and_a_cloth_that_touches_itself_are_refused() -> None:
    slippery = load(
        "inverse_skirt", **COARSE, **{"material.friction": 0.0, "inverse.iterations": 3}
    ).parameters
    with pytest.raises(InputError, match=r"inverse.iterations.*of the weight"):
        ClothModel(slippery)
    with pytest.raises(InputError, match=r"inverse.rest_shape.*touch itself"):
        ClothModel(load("inverse_skirt", **COARSE, **{"contact.self_contact": True}).parameters)
