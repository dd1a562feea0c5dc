"""Fig. 4.6: its runs are scenes that exist, and orbits are compared at the same phase."""

from __future__ import annotations

import numpy as np
import pytest

from barchan import reproductions, scenes
from barchan.reproductions import fibre_orbit
from barchan.reproductions.workshop import Finished


def circle(phase: float = 0.0) -> dict[str, np.ndarray]:
    """Two periods of a tip that goes round a circle of 2 mm, a frame every hundredth of a second."""
    time = np.arange(0.0, 2.0 + 1e-9, 0.01)
    angle = 2.0 * np.pi * time + phase
    places = {"tip_x": 1e-3 * np.cos(angle), "tip_y": 1e-3 * np.sin(angle), "tip_z": 0.0 * angle}
    speeds = {
        "tip_vx": -2e-3 * np.pi * np.sin(angle),
        "tip_vy": 2e-3 * np.pi * np.cos(angle),
        "tip_vz": 0.0 * angle,
    }
    return {"time": time, **places, **speeds}


def finished(found: dict[str, np.ndarray]) -> Finished:
    return Finished({}, found, None)  # type: ignore[arg-type]


def test_every_solver_has_a_scene() -> None:
    assert "fibre_orbit" in reproductions.NAMES
    runs = {
        name: {"solver.method": m, "solver.local_solver": local}
        for name, (m, local) in fibre_orbit.EXACT.items()
    }
    for label, over in (runs | fibre_orbit.PYRAMIDS).items():
        job = fibre_orbit._job(label, over)
        assert scenes.load(job.scene, **job.overrides).parameters.time.end == fibre_orbit.SECONDS  # type: ignore[attr-defined]


def test_an_orbit_is_as_far_from_another_as_their_phases() -> None:
    one = fibre_orbit.orbit(finished(circle()))
    assert one.shape == (100, 6)
    assert fibre_orbit.difference(one, one) == 0.0
    shifted = fibre_orbit.orbit(finished(circle(0.02)))
    # a chord of the angle over the extent of the orbit, a square of side 2 r
    assert fibre_orbit.difference(one, shifted) == pytest.approx(0.02 / np.sqrt(8.0), rel=0.05)
    assert fibre_orbit.drift(finished(circle())) == pytest.approx(0.0, abs=1e-9)
