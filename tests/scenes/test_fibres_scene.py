"""Scenes of fibres: what they store, the same bytes after a restart, written problems, what they refuse, what friction does."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import friction, results, scenes
from barchan.bodies.rigid.rotations import logarithm, matrix
from barchan.errors import InputError
from barchan.results.fibre_pictures import picture, side_view
from barchan.results.fibre_scenes import FibreScene
from barchan.results.solid_scenes import painter
from barchan.scenes.kinds.fibres.entries import RootsGroup
from barchan.scenes.kinds.fibres.making import build_obstacles, laid_strands
from barchan.scenes.kinds.fibres.model import FibresModel
from barchan.scenes.kinds.fibres.motions import carried, root_motion

WISP: dict[str, Any] = {
    "fibres.count": 12, "fibres.segments": 3, "fibres.length": 0.06, "contact.bare": 0.002, "time.end": 0.02,
    "time.frame_rate": 100.0, "time.step": 0.002,
}  # fmt: skip


def stepped(name: str, steps: int, **overrides: Any) -> tuple[FibresModel, Any, list[Any]]:
    model = scenes.load(name, **overrides).model()
    state, records = model.initial(), []
    for _ in range(steps):
        state, record = model.advance(state, model.longest_step(state))
        records.append(record)
    return model, state, records  # type: ignore[return-value]


@pytest.mark.parametrize("model", ["rods", "helices"])
def test_a_wisp_is_stored_with_its_contacts_and_pictures(tmp_path: Path, model: str) -> None:
    scene = scenes.load("wisp", **WISP, **{"fibres.model": model, "observe.write_problems_every": 5})
    run = scene.run(out=tmp_path, progress=False)
    assert run.summary["converged"] and run.summary["steps"] == 10
    assert run.summary["most_contacts"] > 0 and run.summary["deepest_relative_of_all"] < 1.0
    stored = results.open(tmp_path)
    nodes = stored.particles(-1)
    assert len(nodes["positions"]) == len(nodes["fibres"]) and nodes["fibres"].max() == 11
    volume = np.pi * 1e-8 * sum(laid_strands(scene.parameters.fibres).lengths)  # type: ignore[attr-defined]
    assert np.sum(nodes["volumes"]) == pytest.approx(volume, rel=1e-2)
    written = sorted((tmp_path / "problems").iterdir())
    assert [path.name for path in written] == ["step_000005.hdf5", "step_000010.hdf5"]
    assert friction.solve(friction.read(written[-1]), tol=1e-6).converged
    assert {"fibres.png", "curves.png", "fibres.gif"} <= {
        path.name for path in (tmp_path / "pictures").iterdir()
    }
    assert json.loads((tmp_path / "summary.json").read_text())["steps"] == 10


def test_a_run_that_goes_on_from_a_checkpoint_is_the_same_to_the_last_bit() -> None:
    model, middle, _ = stepped("wisp", 5, **WISP)
    again = scenes.load("wisp", **WISP).model()
    ends = []
    for own, state in ((model, middle), (again, again.restore(model.arrays(middle)))):
        for _ in range(5):
            state, _ = own.advance(state, 0.002)
        ends.append(own.arrays(state))
    assert (
        all(np.array_equal(ends[0][key], ends[1][key]) for key in ends[0])
        and ends[0].keys() == ends[1].keys()
    )


def test_friction_holds_a_swung_wisp_together() -> None:
    """Friction takes energy out of a wisp; without it none of the contacts pulls sideways."""
    energies = []
    for mu in (0.0, 0.6):
        _, state, records = stepped("wisp", 50, **WISP, **{"contact.friction": mu})
        energies.append(sum(record.kinetic_energy for record in records))
        sideways = np.abs(state.forces[:, 1:])
        assert np.max(sideways, initial=0.0) <= mu * np.max(state.forces[:, 0], initial=0.0) + 1e-12
    assert energies[1] < energies[0]


def test_a_ponytail_starts_apart_and_meets() -> None:
    over = {"fibres.count": 60, "fibres.splay_deg": 0.0, "fibres.variation": 20.0}
    _, _, records = stepped("ponytail", 8, **over)
    assert records[0].deepest == 0.0 and max(record.candidates for record in records) > 20
    assert all(record.converged for record in records)


def test_the_fibre_reaches_its_ball_and_slides_on_it() -> None:
    model, state, records = stepped("fibre_on_ball", 90)
    assert records[-1].contacts > 0 and state.contacts.bodies.max() == 0
    assert all(record.converged for record in records)
    pyramid, other, _ = stepped("fibre_on_ball", 90, **{"contact.law": "faceted"})
    assert (
        np.linalg.norm(model.fibres.centre_line(state.shape) - pyramid.fibres.centre_line(other.shape)) > 1e-6
    )


def test_roots_move_as_they_are_told() -> None:
    soft = root_motion(RootsGroup(motion="head_turn", angle_deg=90.0, start=1.0, duration=2.0))
    assert np.linalg.norm(logarithm(soft(1.0)[1])) == 0.0
    assert np.linalg.norm(logarithm(soft(2.0)[1])) == pytest.approx(math.radians(45.0))
    assert np.linalg.norm(logarithm(soft(9.0)[1])) == pytest.approx(math.radians(90.0))
    swing = root_motion(
        RootsGroup(motion="oscillation", amplitude=[0.1, 0.0, 0.0], frequency=2.0, stop=0.125)
    )
    assert swing(0.125)[0][0] == pytest.approx(0.1) == pytest.approx(swing(5.0)[0][0])
    turning = RootsGroup(motion="rotation", turn_rate=math.pi, axis=[0.0, 0.0, 2.0], pivot=[1.0, 0.0, 0.0])
    place, turn = carried(root_motion(turning), np.array([2.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))(
        1.0
    )
    np.testing.assert_allclose(place, [0.0, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(matrix(turn), np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


def test_bodies_move_to_and_fro_or_with_the_roots() -> None:
    ball = build_obstacles(scenes.load("fibre_on_ball").parameters)[0]  # type: ignore[arg-type]
    quarter = ball.motion.rotation_at(0.25)  # type: ignore[union-attr]
    np.testing.assert_allclose(np.degrees(logarithm(quarter)), [12.0, 12.0, 20.0], atol=0.01)
    head = build_obstacles(scenes.load("ponytail").parameters)[0]  # type: ignore[arg-type]
    end = logarithm(head.motion.rotation_at(1.0))  # type: ignore[union-attr]
    np.testing.assert_allclose(np.degrees(end), [0.0, 0.0, 60.0], atol=1e-6)


def test_pictures_without_pyvista_show_the_fibres() -> None:
    scene = scenes.load("fibre_on_ball", **{"time.end": 0.02, "time.frame_rate": 50.0})
    run = scene.run(progress=False)
    shown = FibreScene(build_obstacles(scene.parameters), 1e-3, run.results)  # type: ignore[arg-type]
    image = side_view(shown, 0, (200, 160))
    assert image.shape == (160, 200, 3) and image.min() < 150  # something is drawn on white
    assert painter(picture, side_view) is not None


@pytest.mark.parametrize(
    ("name", "overrides", "field"),
    [
        ("wisp", {"fibres.radius": 0.05}, "fibres.radius"),
        ("wisp", {"fibres.spacing": 2.0}, "fibres.spacing"),
        ("wisp", {"fibres.splay_deg": 5.0}, "fibres.splay_deg"),
        ("wisp", {"fibres.direction": [0.0, 0.0, 0.0]}, "fibres.direction"),
        ("wisp", {"fibres.direction": [0.0, 1.0]}, "fibres.direction"),
        ("wisp", {"solver.method": "magic"}, "solver.method"),
        ("wisp", {"solver.local_solver": "enumerative"}, "solver.local_solver"),
        ("wisp", {"solver.method": "gauss_seidel", "solver.local_solver": "magic"}, "solver.local_solver"),
        ("wisp", {"contact.law": "faceted", "solver.method": "gauss_seidel"}, "solver.method"),
        ("wisp", {"time.step": 1e-9}, "time.step"),
        ("fibre_on_ball", {"fibres.count": 2}, "fibres.count"),
        ("fibre_on_ball", {"bodies.ball.radius": -1.0}, "bodies.ball.radius"),
        ("fibre_on_ball", {"bodies.ball.motion": "free"}, "bodies.ball.motion"),
        ("wisp", {"fibres.start": "natural", "fibres.curl": 400.0}, "fibres.spacing"),
    ],
)
def test_scenes_that_make_no_sense_are_refused(name: str, overrides: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as caught:
        scenes.load(name, **overrides).model()
    assert caught.value.field == field
