"""Scenes of bodies in frictional contact: the laws they keep, what they store, what they refuse."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import friction, scenes
from barchan.errors import InputError
from barchan.scenes.kinds.bodies.cards import card_places
from barchan.scenes.kinds.bodies.model import MoreauModel
from barchan.scenes.kinds.bodies.observables import surface_angle

TINY_PILE: dict[str, Any] = {
    "generators.grain.count": 12, "generators.grain.lower": [-0.03, -0.03, 0.02],
    "generators.grain.upper": [0.03, 0.03, 0.12], "generators.rough.lower": [-0.04, -0.04, 0.0],
    "generators.rough.upper": [0.04, 0.04, 0.005], "generators.box.lower": [-0.04, -0.04, -0.1],
    "generators.box.upper": [0.04, 0.04, 1.0],
}  # fmt: skip


def run_steps(name: str, steps: int, **overrides: Any) -> tuple[MoreauModel, Any, list[Any]]:
    model = scenes.load(name, **overrides).model()
    state, records = model.initial(), []
    for _ in range(steps):
        state, record = model.advance(state, model.longest_step(state))
        records.append(record)
    return model, state, records  # type: ignore[return-value]


@pytest.mark.filterwarnings("ignore:time.step")  # of cards that fall
def test_a_card_house_stands_while_its_friction_is_above_the_tangent_of_the_lean() -> None:
    lean = math.tan(math.radians(15.0))
    for storeys in (2, 4):
        for excess, stands in ((0.01, True), (-0.02, False)):
            mu = {"generators.card.friction": lean + excess, "bodies.table.friction": lean + excess}
            model, state, records = run_steps("card_house", 12, **{"generators.card.storeys": storeys}, **mu)
            moved = model.observables(state, records[-1])["displacement_relative"]
            assert (moved < 1e-6) if stands else (moved > 1e-4), (storeys, excess, moved)


def test_cards_touch_and_do_not_overlap() -> None:
    places = card_places(3, 0.1, 0.002, 0.2)
    assert len(places) == 2 * (3 + 2 + 1) + 2 + 1
    model = scenes.load("card_house").model()
    gaps = model.assembly.geometry.detect(model.initial().bodies, 1e-9).gaps  # type: ignore[attr-defined]
    assert np.max(np.abs(gaps)) < 1e-12
    assert len(gaps) >= 2 * (4 + 3 + 2 + 1) + 4 + 3 + 2 + 1


def test_a_block_slides_down_its_slope_as_coulomb_says() -> None:
    model, state, records = run_steps("inclined_plane", 20)
    found = model.observables(state, records[-1])
    exact = 9.81 * (0.5 - 0.4 * math.sqrt(0.75)) * 0.2
    assert found["sliding_speed_exact"] == pytest.approx(exact, rel=1e-12)
    assert found["sliding_speed"] == pytest.approx(exact, rel=1e-9)
    model, state, records = run_steps("inclined_plane", 20, **{"scene.slope_deg": 21.0})
    found = model.observables(state, records[-1])
    assert found["sliding_speed_exact"] == 0.0 and abs(found["sliding_speed"]) < 1e-9


def test_the_cradle_hands_its_speed_to_the_last_ball() -> None:
    over = {"bodies.ball_0.position": [-0.0806, 0.1000002], "joints.string_0.anchor": [-0.0806, 0.1000002],
            "bodies.ball_0.velocity": [1.0, 0.0], "time.step": 1.6e-4}  # fmt: skip
    _, state, records = run_steps("newton_cradle", 30, **over)
    speeds = state.bodies.velocities[1:, 0]
    assert speeds[-1] == pytest.approx(1.0, abs=0.02)
    assert np.max(np.abs(speeds[:-1])) < 0.02
    assert records[-1].kinetic_energy <= records[0].kinetic_energy * (1.0 + 1e-9)


@pytest.mark.parametrize("step", [5e-4, 5e-5])
def test_a_rod_that_cannot_slide_jams_in_one_step_whatever_its_length(step: float) -> None:
    model = scenes.load("painleve_rod", **{"time.step": step}).model()
    state, touched = model.initial(), 0
    for _ in range(20):
        if touched:
            break
        state, record = model.advance(state, step)
        touched = record.contacts  # type: ignore[attr-defined]
    tip = np.array([-0.25, -math.sqrt(3.0) / 4.0])
    spin, speed = state.bodies.spins[1, 0], state.bodies.velocities[1]
    at_tip = speed + spin * np.array([-tip[1], tip[0]])
    assert np.all(np.abs(at_tip) < 5e-3)  # it slid at 1 m/s
    # the impulse that stops the tip keeps the angular momentum about it, at any step: (m/3) L^2 w = m v (L/2) sin 60
    assert spin == pytest.approx(0.75 * math.sqrt(3.0), abs=5e-3)
    sliding = run_steps("painleve_rod", 4, **{"bodies.rod.friction": 1.2, "bodies.ground.friction": 1.2})[1]
    assert sliding.bodies.velocities[1, 0] < -0.8  # below 4/3 it goes on sliding


def test_a_run_stores_bodies_and_contacts_and_comes_to_rest(tmp_path: Path) -> None:
    scene = scenes.load(
        "pile", **TINY_PILE, **{"time.end": 1.0, "time.frame_rate": 10.0, "time.rest_speed": 0.5}
    )
    run = scene.run(out=tmp_path / "run", progress=False, pictures=False)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["converged"] and summary["worst_certificate"] <= 1e-4
    assert run.results.frames < 11  # the run has ended at rest
    assert summary["deepest_relative_of_all"] < 0.01
    bodies, contacts = run.results.particles(-1), run.results._group(-1, "contacts")
    assert bodies["rotations"].shape == (len(bodies["positions"]), 4)
    assert set(bodies["shape_kinds"]) == {0, 3}
    grains = bodies["volumes"] > 0.0
    assert np.allclose(
        bodies["shape_sizes"][grains, 0] ** 3 * 4.0 / 3.0 * np.pi, bodies["volumes"][grains], rtol=1e-5
    )
    assert contacts["forces"].shape == contacts["positions"].shape == contacts["normals"].shape
    assert len(contacts["pairs"]) == run.observables["contacts"][-1] > 0
    assert np.all(np.sum(contacts["forces"] * contacts["normals"], axis=1) > 0.0)


def test_a_resumed_run_has_the_same_bytes(tmp_path: Path) -> None:
    over = {**TINY_PILE, "time.end": 0.06, "time.frame_rate": 50.0}
    model = scenes.load("pile", **over).model()
    state = model.initial()
    for _ in range(10):
        state, _ = model.advance(state, 0.002)
    again = scenes.load("pile", **over).model()
    restored = again.restore(model.arrays(state))
    one, two = model.advance(state, 0.002), again.advance(restored, 0.002)
    assert all(
        np.array_equal(a, b)
        for a, b in zip(model.arrays(one[0]).values(), again.arrays(two[0]).values(), strict=True)
    )
    assert one[1] == two[1]


def test_problems_go_to_the_run_folder_and_their_solutions_are_certified(tmp_path: Path) -> None:
    over = {"observe.write_problems_every": 2, "time.end": 0.04, "time.frame_rate": 50.0}
    scene = scenes.load("box_stack", **over)
    run = scene.run(out=tmp_path / "run", progress=False, pictures=False)
    files = sorted((tmp_path / "run" / "problems").iterdir())
    assert [file.name for file in files] == ["step_000002.hdf5", "step_000004.hdf5"]
    for file in files:
        problem = friction.read(str(file))
        assert problem.n == 20
        solution = friction.solve(problem, tol=1e-8)
        assert solution.converged and friction.certify(problem, solution.r).residual <= 1e-8
    assert not run.already_finished
    assert scene.run(out=tmp_path / "run", resume=True, progress=False, pictures=False).already_finished


def test_every_step_of_a_turning_drum_meets_its_certificate_and_no_discs_overlap() -> None:
    model = scenes.load("drum").model()
    state, radius = model.initial(), 0.008 * 0.85
    for _ in range(120):
        state, record = model.advance(state, 0.004)
        assert record.converged and record.deepest < 0.01 * radius


@pytest.mark.slow
def test_a_poured_pile_comes_to_rest() -> None:
    model = scenes.load("pile").model()
    state = model.initial()
    while not model.ended(state):
        state, record = model.advance(state, 0.002)
        assert record.converged and record.deepest < 1e-4 and state.time < 1.5


def test_soft_spheres_run_the_same_scene_with_the_same_output(tmp_path: Path) -> None:
    over: dict[str, Any] = {
        "contact.method": "soft", "contact.restitution": 0.5, "contact.stiffness": 2e4, "contact.margin": 0.0,
        "time.end": 0.1, "time.frame_rate": 20.0, **TINY_PILE,
    }  # fmt: skip
    run = scenes.load("pile", **over).run(out=tmp_path / "run", progress=False, pictures=False)
    assert run.summary["converged"]
    found = run.observables
    total = (
        found["kinetic_energy"]
        + found["potential_energy"]
        + found["elastic_energy"]
        + found["dissipated_energy"]
    )
    assert np.ptp(total) < 0.01 * abs(found["potential_energy"][0])
    assert set(run.results.particles(-1)["shape_kinds"]) == {0, 3}
    assert run.results._group(-1, "contacts")["pairs"].shape[1] == 2


def test_a_shear_cell_keeps_its_pressure() -> None:
    over: dict[str, Any] = {
        "generators.disc.count": 64, "generators.disc.upper": [10.5, 10.5], "cell.size": [10.5, 10.5], "time.end": 30.0,
        "time.step": 0.1, "time.frame_rate": 10.0,
    }  # fmt: skip
    found = scenes.load("shear_cell", **over).run(progress=False).observables
    late = found["time"] > 12.0
    assert np.mean(found["normal_stress"][late]) == pytest.approx(1.0, abs=0.2)
    assert 0.2 < np.mean(found["shear_stress"][late]) < 0.7
    assert 0.7 < np.mean(found["volume_fraction"][late]) < 0.86


def test_overlapping_bodies_are_refused_with_the_deepest_pair_or_pushed_apart() -> None:
    boxes = {
        "scene": {"name": "two", "kind": "bodies", "dimension": 2},
        "bodies": {
            "floor": {"shape": "plane", "motion": "fixed", "position": [0.0, 0.0]},
            "low": {"shape": "box", "size": [0.1, 0.1], "position": [0.0, 0.049], "density": 1.0},
            "high": {"shape": "box", "size": [0.1, 0.1], "position": [0.0, 0.139], "density": 1.0},
        },
        "time": {"end": 0.1, "frame_rate": 10.0, "step": 0.01},
    }  # fmt: skip
    with pytest.raises(InputError, match=r"'low' and 'high' overlap by 0\.01 m") as refusal:
        _validated(boxes).model()
    assert refusal.value.field == "bodies.low"
    model = _validated({**boxes, "contact": {"relax": 50}}).model()
    z = model.initial().bodies.positions[:, 1]
    assert z[1] >= 0.05 - 2e-7 and z[2] - z[1] >= 0.1 - 2e-7
    assert np.all(model.initial().bodies.velocities == 0.0)


def _validated(tables: dict[str, Any]) -> scenes.Scene:
    from barchan.scenes.validation import validate

    return scenes.Scene(validate(tables))


def test_a_step_that_lets_a_body_cross_a_wall_is_warned_of_with_the_pair() -> None:
    tables = {
        "scene": {"name": "shot", "kind": "bodies", "dimension": 2, "gravity": 0.0},
        "bodies": {
            "ball": {"shape": "sphere", "radius": 0.01, "position": [0.0, 0.0], "velocity": [50.0, 0.0], "density": 1.0},
            "wall": {"shape": "box", "size": [0.02, 1.0], "position": [0.3, 0.0], "motion": "fixed"},
        },
        "time": {"end": 0.1, "frame_rate": 10.0, "step": 0.01},
    }  # fmt: skip
    model = _validated(tables).model()
    with pytest.warns(UserWarning, match="'ball' goes 0.5 m in one step and could cross 'wall'"):
        state, record = model.advance(model.initial(), 0.01)
    assert record.crossings == 1
    assert state.bodies.positions[0, 0] < 0.29 + 1e-9  # the step itself has seen the wall


@pytest.mark.parametrize(
    ("name", "over", "field"),
    [
        ("box_stack", {"generators.box.density": 0.0}, "generators.box.density"),
        ("inclined_plane", {"bodies.block.mass": -1.0}, "bodies.block.mass"),
        ("inclined_plane", {"bodies.block.mass": 1.0}, "bodies.block.density"),
        ("inclined_plane", {"bodies.block.shape": "polygon"}, "bodies.block.shape"),
        ("inclined_plane", {"bodies.block.shape": "capsule"}, "bodies.block.radius"),
        (
            "inclined_plane",
            {"bodies.ground.motion": "free", "bodies.ground.mass": 1.0},
            "bodies.ground.motion",
        ),
        ("inclined_plane", {"observe.sliding": "blok"}, "observe.sliding"),
        ("box_stack", {"generators.box.size": [0.1, 0.1, 0.1]}, "generators.box.size"),
        ("box_stack", {"solver.method": "magic"}, "solver.method"),
        ("box_stack", {"contact.pairs": [["floor", "bx_0", 0.5]]}, "contact.pairs"),
        ("box_stack", {"contact.method": "soft"}, "contact.restitution"),
        ("pile", {"generators.grain.count": 100_000}, "generators.grain.upper"),
        ("newton_cradle", {"joints.string_0.first": "bell"}, "joints.string_0.first"),
        ("shear_cell", {"contact.method": "moreau"}, "cell.size"),
        ("silo_grains", {"generators.bottom.outlet": 0.5}, "generators.bottom.outlet"),
        ("card_house", {"generators.card.size": [0.09, 0.01]}, "generators.card.size"),
    ],
)
def test_bad_input_is_named(name: str, over: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as refusal:
        scenes.load(name, **over).model()
    assert refusal.value.field == field


def test_a_hull_with_a_corner_inside_is_refused() -> None:
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.2, 0.2]]
    tables = {
        "scene": {"name": "hull", "kind": "bodies", "dimension": 3},
        "bodies": {"hull": {"shape": "hull", "points": corners, "position": [0.0, 0.0, 0.0], "density": 1.0}},
        "time": {"end": 0.1, "frame_rate": 10.0, "step": 0.01},
    }
    with pytest.raises(InputError) as refusal:
        _validated(tables).model()
    assert refusal.value.field == "bodies.hull.points"


def test_the_slope_of_a_surface_is_that_of_its_highest_bodies() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, 4000)
    middle = np.stack([x, rng.uniform(-1.0, 0.5 * x)], axis=1)
    angle = surface_angle(middle, np.full((4000, 2), 0.01), (-0.8, 0.8))
    assert angle == pytest.approx(math.degrees(math.atan(0.5)), abs=1.0)


@pytest.mark.parametrize("name", ["box_stack", "drum"])
def test_plane_scenes_are_drawn(name: str, tmp_path: Path) -> None:
    over = {"time.end": 0.02, "time.frame_rate": 50.0}
    if name == "drum":
        over |= {"generators.disc.count": 20}
    run = scenes.load(name, **over).run(out=tmp_path / "run", progress=False)
    for picture in ("bodies.png", "forces.png", "curves.png", "bodies.gif"):
        assert (run.folder / "pictures" / picture).stat().st_size > 2000  # type: ignore[operator]


def test_solid_scenes_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    over = {**TINY_PILE, "time.end": 0.02, "time.frame_rate": 50.0}
    run = scenes.load("pile", **over).run(out=tmp_path / "run", progress=False)
    for picture in ("bodies.png", "forces.png", "bodies.gif"):
        assert (run.folder / "pictures" / picture).stat().st_size > 2000  # type: ignore[operator]


def test_a_point_of_the_friction_law_is_read_off_a_shear_run() -> None:
    from barchan.reproductions.grains_to_fields import shear_point

    rng = np.random.default_rng(1)
    pressure = 1.0 + 0.01 * rng.normal(size=200)
    found = {
        "time": np.arange(200.0), "normal_stress": pressure, "shear_stress": 0.3 * pressure, "pressure": pressure,
        "inertial_number": 0.1 / np.sqrt(pressure), "volume_fraction": np.full(200, 0.8),
    }  # fmt: skip
    number, mu, error, phi = shear_point(found, 0.25)
    assert (number, mu, phi) == (pytest.approx(0.1, rel=1e-2), pytest.approx(0.3), pytest.approx(0.8))
    assert error < 1e-9


def test_straight_data_fix_the_slope_of_the_friction_law_and_not_its_end() -> None:
    from barchan.reproductions.grains_to_fields import law_of

    inertial = np.array([0.01, 0.02, 0.05, 0.1])
    straight = np.stack([inertial, 0.3 + 1.5 * inertial, np.full(4, 0.005), np.full(4, 0.8)], axis=1)
    law = law_of(straight)
    assert float(law.I_0) == pytest.approx(0.3)
    assert law.mu_s == pytest.approx(0.3, abs=0.02) and law.mu_2 < 1.5
    assert np.allclose(law.friction(inertial), straight[:, 1], atol=0.01)
    bent = straight.copy()
    bent[:, 1] = 0.3 + 0.4 * inertial / (0.05 + inertial)
    assert float(law_of(bent).I_0) == pytest.approx(0.05, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box_stack", "card_house"])
def test_what_stands_stands_for_ten_seconds(name: str) -> None:
    model, state, records = run_steps(name, 1000)
    assert model.observables(state, records[-1])["displacement_relative"] < 1e-6
    assert all(record.converged for record in records)
