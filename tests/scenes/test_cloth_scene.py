"""Scenes of cloth: what friction decides, what they store, what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.errors import InputError
from barchan.results.cloth_pictures import picture, shaded_view
from barchan.results.cloth_scenes import ClothScene
from barchan.results.reader import open_results
from barchan.results.solid_scenes import painter
from barchan.scenes.kinds.cloth.entries import ClothBodyEntry
from barchan.scenes.kinds.cloth.making import build_obstacles, driven_time

COARSE: dict[str, Any] = {"cloth.spacing": 0.17, "time.step": 0.01}


def run_steps(name: str, steps: int, **overrides: Any) -> tuple[Any, Any, list[Any]]:
    model = scenes.load(name, **overrides).model()
    state, records = model.initial(), []
    for _ in range(steps):
        state, record = model.advance(state, model.longest_step(state))
        records.append(record)
    return model, state, records


def test_friction_decides_whether_the_cloth_stays_on_the_ball() -> None:
    heights = {}
    for mu in (0.05, 0.8):
        over = {
            **COARSE,
            "material.friction": mu,
            "material.mass_damping": 2.0,
            "cloth.position": [0.2, 0.0, 0.31],
        }
        model, state, records = run_steps("cloth_on_sphere", 90, **over)
        assert all(record.converged for record in records)
        heights[mu] = model.observables(state, records[-1])["centre_z"]
    assert heights[0.05] < -0.35 < -0.15 < heights[0.8]


def test_hips_hold_and_turn_the_skirt() -> None:
    over = {"cloth.spacing": 0.09, "time.step": 0.01, "bodies.hips.start": 0.0, "bodies.hips.ramp": 0.1}
    model, state, records = run_steps("skirt", 40, **over)
    assert all(record.converged for record in records)
    found = model.observables(state, records[-1])
    assert found["highest"] > -0.06  # it has not slipped off
    assert found["cloth_spin"] > 0.5
    assert found["contacts"] > 5


def test_a_run_leaves_a_mesh_contacts_pictures_and_the_same_numbers_in_memory(tmp_path: Path) -> None:
    over = {**COARSE, "time.end": 0.2, "time.frame_rate": 20.0, "cloth.position": [0.1, 0.0, 0.302]}
    over |= {"observe.write_problems_every": 10}
    run = scenes.load("cloth_on_sphere", **over).run(out=tmp_path / "run", progress=False)
    assert run.summary["converged"] and run.summary["steps"] == 20
    assert len(list((tmp_path / "run" / "problems").iterdir())) == 2
    for name in ("cloth.png", "curves.png", "cloth.gif"):
        assert (tmp_path / "run" / "pictures" / name).stat().st_size > 1000
    results = open_results(tmp_path / "run")
    grid = results.grid(-1)
    assert grid["cells"].shape[1] == 3 and grid["positions"].shape == grid["velocities"].shape
    scene = ClothScene(build_obstacles(scenes.load("cloth_on_sphere", **over).parameters), results)
    for draw in (painter(picture, shaded_view), shaded_view):
        image = draw(scene, results.frames - 1, (120, 100))
        assert image.shape == (100, 120, 3) and len(np.unique(image.reshape(-1, 3), axis=0)) > 20
    again = scenes.load("cloth_on_sphere", **over).run(progress=False)
    for name, values in run.observables.items():
        np.testing.assert_array_equal(values, again.observables[name])


def test_driven_bodies_speed_up_and_stop_softly() -> None:
    entry = ClothBodyEntry(shape="sphere", motion="moving", start=0.5, ramp=0.2, stop=1.5)
    times = np.linspace(0.0, 3.0, 3001)
    speed = np.gradient(driven_time(entry, times), times)
    assert np.all(speed[times < 0.49] == 0.0)
    np.testing.assert_allclose(speed[(times > 0.71) & (times < 1.49)], 1.0, atol=1e-9)
    np.testing.assert_allclose(speed[times > 1.71], 0.0, atol=1e-9)
    assert np.max(np.abs(np.diff(speed))) < 0.01


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"cloth.size": [1.0]}, "cloth.size"),
        ({"cloth.shape": "disc"}, "cloth.radius"),
        ({"cloth.spacing": 3.0}, "cloth.spacing"),
        ({"cloth.position": [0.0, 0.0, 0.29]}, "cloth.position"),
        ({"pins.where": "waist"}, "pins.where"),
        ({"pins.where": "points"}, "pins.points"),
        ({"pins.body": "nobody"}, "pins.body"),
        ({"material.poisson_ratio": 0.7}, "material.poisson_ratio"),
        ({"bodies.ball.spin": [0.0, 0.0, 1.0]}, "bodies.ball.motion"),
        ({"bodies.ball.radius": -1.0}, "bodies.ball.radius"),
        ({"solver.method": "magic"}, "solver.method"),
        ({"time.frame_rate": 1e9}, "time.frame_rate"),
    ],
)
def test_bad_scenes_name_their_key(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match=key):
        scenes.load("cloth_on_sphere", **{**COARSE, **changes}).model()


def test_a_mesh_from_a_file_is_a_cloth_and_one_with_holes_in_its_logic_is_not(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.off", tmp_path / "bad.off"
    corners = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    good.write_text(f"OFF\n4 2 0\n{corners}3 0 1 2\n3 0 2 3\n")
    bad.write_text(f"OFF\n4 2 0\n{corners}3 0 1 2\n3 0 3 2\n")
    base = {"cloth.shape": "mesh", "cloth.position": [0.0, 0.0, 0.5]}
    model = scenes.load("cloth_on_sphere", **base, **{"cloth.file": str(good)}).model()
    assert len(model.initial().positions) == 4
    with pytest.raises(InputError, match=r"cloth\.file"):
        scenes.load("cloth_on_sphere", **base, **{"cloth.file": str(bad)}).model()
