"""Scenes of chains: models side by side, what they store, what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames

SHORT: dict[str, Any] = {"time.end": 0.2, "time.frame_rate": 20.0, "time.step": 0.005}
FALLING: dict[str, Any] = {
    **SHORT, "chain.held": False, "chain.segments": 4, "chain.half_lengths": [0.05], "chain.angles": [-20.0],
    "chain.root": [0.0, 0.2], "obstacles.floor": {"shape": "plane", "position": [0.0, 0.0]},
    "obstacles.stone": {"shape": "disc", "position": [0.4, 0.0], "radius": 0.05, "friction": 0.9},
}  # fmt: skip


def test_the_pendulum_follows_the_exact_motion_in_all_models(tmp_path: Path) -> None:
    run = scenes.load("pendulum", **SHORT).run(out=tmp_path / "run", progress=False)
    found = run.observables
    for name in ("maximal", "lumped", "reduced"):
        errors = found[f"error_{name}"]
        assert errors[0] < 1e-12 and 0.0 < errors[-1] < 0.02
        apart = np.hypot(*(found[f"tip_{axis}_{name}"] - found[f"tip_{axis}_exact"] for axis in "xz"))
        assert np.all(apart <= errors + 1e-12)
    assert 0.0 < np.max(found["difference"]) < 0.02
    assert run.summary["converged"] and run.summary["worst_certificate"] <= 1e-6
    assert run.summary["steps"] == 40
    particles = run.results.particles(-1)
    assert particles["positions"].shape == (3 * 4, 2) and set(particles["models"]) == {0, 1, 2}
    tips = particles["positions"][[3, 7, 11], 0]
    np.testing.assert_allclose(
        tips, [found[f"tip_x_{name}"][-1] for name in ("maximal", "lumped", "reduced")], atol=1e-6
    )
    pictures = {path.name for path in (tmp_path / "run" / "pictures").iterdir()}
    assert pictures == {"chain.png", "tip.png", "curves.png", "chain.gif"}


def test_finer_steps_are_nearer_by_the_first_order() -> None:
    errors = []
    for step in (0.004, 0.002):
        run = scenes.load("pendulum", **{**SHORT, "time.step": step, "solver.model": "reduced"}).run(
            progress=False
        )
        errors.append(run.observables["error_reduced"][-1])
        assert "difference" in run.observables and "error_maximal" not in run.observables
    assert 1.7 < errors[0] / errors[1] < 2.3


def test_a_chain_that_falls_stores_its_contacts(tmp_path: Path) -> None:
    run = scenes.load("pendulum", **FALLING).run(out=tmp_path / "run", progress=False)
    assert run.observables["contacts"][-1] > 0 and "error_maximal" not in run.observables
    assert run.summary["converged"]
    contacts = run.results._group(-1, "contacts")
    assert contacts["positions"].shape == contacts["forces"].shape == (len(contacts["joints"]), 2)
    frames = contact_frames(contacts["normals"].astype(float))
    normal, along = np.einsum("kij,kj->ik", frames, contacts["forces"])
    assert np.all(normal > 0.0) and np.all(np.abs(along) <= 0.671 * normal + 1e-4)
    assert np.max(contacts["joints"]) < 3 * 5
    assert (tmp_path / "run" / "pictures" / "chain.gif").stat().st_size <= 3_000_000


def test_a_restored_state_goes_on_with_the_same_bytes() -> None:
    model = scenes.load("pendulum", **FALLING).model()
    state = model.initial()
    for _ in range(30):
        state, _ = model.advance(state, 0.005)
    again = model.restore(model.arrays(state))
    for _ in range(3):
        (state, record), (again, same) = model.advance(state, 0.005), model.advance(again, 0.005)
        assert record == same
    here, there = model.arrays(state), model.arrays(again)
    assert here.keys() == there.keys()
    for name, values in here.items():
        np.testing.assert_array_equal(values, there[name])


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("chain.half_lengths", {"chain.half_lengths": [0.1, 0.1]}),
        ("chain.half_lengths", {"chain.half_lengths": [0.1, 0.0, 0.1]}),
        ("chain.line_densities", {"chain.line_densities": [-1.0]}),
        ("chain.clamp", {"chain.clamp": 0.0, "chain.held": False}),
        ("chain.root", {"chain.root": [0.0]}),
        ("solver.method", {"solver.method": "wishes"}),
        ("solver.model", {"solver.model": "wishes"}),
        ("obstacles.stone.radius", {"obstacles.stone": {"shape": "disc", "position": [0.0, -9.0]}}),
        ("obstacles.floor.normal", {
            "obstacles.floor": {"shape": "plane", "position": [0.0, -9.0], "normal": [0.0, 0.0]}
        }),
        ("obstacles", {"obstacles.floor": {"shape": "plane", "position": [0.0, -0.1]}}),
        ("time.frame_rate", {"time.frame_rate": 1e6}),
    ],
)  # fmt: skip
def test_bad_scenes_are_refused_by_key(key: str, change: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        scenes.load("pendulum", **change).model()
    assert caught.value.field == key


def test_steps_that_do_not_settle_are_told() -> None:
    over = {**SHORT, "solver.model": "reduced", "solver.iterations": 2}
    run = scenes.load("pendulum", **over).run(progress=False)
    assert not run.summary["converged"] and run.summary["worst_certificate"] <= 1e-6
    assert run.summary["remarks"] == ["in 40 steps 2 linearisations did not settle: shorten time.step"]
