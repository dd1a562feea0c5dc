"""Scenes of quasi-Newtonian flows: what they return, files and pictures they leave, resuming, defaults of the fluids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import results, scenes
from barchan.errors import InputError
from barchan.scenes import finish
from barchan.scenes.fluids import FluidModel
from barchan.scenes.fluids.stream import stream_function, vortex
from barchan.spaces.meshes import rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

SMALL: dict[str, dict[str, Any]] = {
    "cylinder_dfg": {"level": 1},
    "couette": {"level": 2},
    "cavity": {"cells": 8, "eps": 1e-2},
}
STEPPED = {"level": 1, "end": 0.3, "step": 0.05, "frame_rate": 10.0}


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures have their own tests."""
    monkeypatch.setattr(finish, "draw_pictures", lambda *_: None)


class TestRuns:
    @pytest.mark.parametrize("name", SMALL)
    def test_a_steady_scene_leaves_start_solution_and_pictures(self, name: str, tmp_path: Path) -> None:
        run = scenes.load(name, **SMALL[name]).run(tmp_path / "run", progress=False)
        assert run.summary["ended"] == "steady" and run.summary["converged"]
        assert list(run.observables["time"]) == [0.0, 1.0]
        stored = results.open(tmp_path / "run")
        count, fields = len(stored.mesh["positions"]), stored.fields(-1)
        assert fields["velocities"].shape == (count, 2)
        for scalar in ("pressures", "shear_rates", "viscosities", "plug"):
            assert fields[scalar].shape == (count,) and np.all(np.isfinite(fields[scalar]))
        assert np.all(fields["viscosities"] > 0.0)
        pictures = {path.name for path in (tmp_path / "run" / "pictures").iterdir()}
        assert {"fields.png", "residuals.png"} <= pictures

    def test_the_history_of_the_solver_is_kept(self) -> None:
        run = scenes.load("couette", level=2, method="adaptive-newton", delta0=0.5, start="rest").run(
            progress=False
        )
        found = run.observables
        steps = int(found["nonlinear_iterations"][-1])
        assert len(found["residuals"]) == steps + 1 and len(found["weights"]) == steps
        assert found["residuals"][-1] <= 1e-8 * found["residuals"][0]
        assert found["weights"][0] == 0.5

    def test_a_nested_start_is_nearer_than_rest_and_leads_to_the_same_flow(self) -> None:
        rest, nested = (
            scenes.load("couette", level=2, start=start).run(progress=False) for start in ("rest", "nested")
        )
        assert nested.observables["residuals"][0] < 0.1 * rest.observables["residuals"][0]
        assert max(rest.summary["worst_certificate"], nested.summary["worst_certificate"]) <= 1e-8
        speeds = rest.observables["cut_speed"]
        np.testing.assert_allclose(nested.observables["cut_speed"], speeds, atol=1e-6 * speeds.max())

    def test_an_interrupted_run_in_time_resumes_to_the_same_bytes(
        self, no_pictures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        scene = scenes.load("cylinder_dfg", **STEPPED)
        whole = scene.run(tmp_path / "whole", progress=False)
        assert whole.observables["time"] == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert len(whole.results.steps["time"]) == 6
        advance = FluidModel.advance

        def advance_three(self: FluidModel, state: Any, dt: float) -> Any:
            if state.step == 3:
                raise KeyboardInterrupt
            return advance(self, state, dt)

        with monkeypatch.context() as patch:
            patch.setattr(FluidModel, "advance", advance_three)
            with pytest.raises(KeyboardInterrupt):
                scene.run(tmp_path / "parts", progress=False)
        scene.run(tmp_path / "parts", resume=True, progress=False)
        assert (tmp_path / "parts/results.h5").read_bytes() == (tmp_path / "whole/results.h5").read_bytes()


class TestCylinder:
    def test_drag_and_lift_come_near_the_reference(self) -> None:
        run = scenes.load("cylinder_dfg", level=2).run(progress=False)
        assert run.observables["drag"][-1] == pytest.approx(5.579535, rel=1e-3)
        assert run.observables["lift"][-1] == pytest.approx(0.01061894, rel=0.01)
        assert run.observables["pressure_difference"][-1] == pytest.approx(0.11752, rel=0.01)

    @pytest.mark.parametrize(("pressures", "pieces"), [("P1", 2), ("P1d", 6)])
    def test_triangles_give_the_same_drag(self, pressures: str, pieces: int) -> None:
        run = scenes.load("cylinder_dfg", level=2, shape="triangle", pressures=pressures).run(progress=False)
        assert run.observables["drag"][-1] == pytest.approx(5.579535, rel=2e-3)
        assert run.summary["cells"] == 520 * pieces

    def test_a_stepped_flow_comes_to_the_steady_one(self) -> None:
        steady = scenes.load("cylinder_dfg", level=1).run(progress=False)
        stepped = scenes.load("cylinder_dfg", level=1, end=20.0, step=1.0, frame_rate=0.1).run(progress=False)
        for name in ("drag", "lift"):
            assert stepped.observables[name][-1] == pytest.approx(steady.observables[name][-1], rel=1e-3)

    @pytest.mark.parametrize(
        ("fluid", "expected"),
        [
            ("newtonian", {"eta0": 1e-3}),
            ("shear-thinning", {"eta0": 1e-3, "exponent": 1.5, "eps": 0.1}),
            ("shear-thickening", {"eta0": 1e-3, "exponent": 3.0, "eps": 0.1}),
            ("bingham", {"eta0": 1.0, "tau0": 0.5, "eps": 0.01}),
        ],
    )
    def test_a_fluid_has_the_parameters_of_the_seed(self, fluid: str, expected: dict[str, float]) -> None:
        material = scenes.load("cylinder_dfg", fluid=fluid).parameters.model_dump()["material"]
        assert {key: value for key, value in material.items() if value is not None} == {
            "fluid": fluid,
            **expected,
        }

    def test_eps_is_added_to_the_square_of_the_rate_as_it_is(self) -> None:
        model = scenes.load("cylinder_dfg", fluid="bingham", level=1, eps=0.04).model()
        assert isinstance(model, FluidModel)
        assert model.flow.model.eps == pytest.approx(0.2)


class TestCouette:
    def test_the_cut_comes_to_the_exact_profile(self) -> None:
        coarse, fine = (
            scenes.load("couette", level=level).run(progress=False).observables for level in (1, 3)
        )
        assert len(fine["cut_r"]) == len(fine["cut_speed"]) == len(fine["exact_speed"])
        for name in ("speed", "shear_rate", "viscosity"):
            assert fine[f"xi_{name}"][-1] < 0.3 * coarse[f"xi_{name}"][-1]
        assert fine["xi_speed"][-1] < 0.5

    def test_the_moment_on_the_cylinder_is_the_exact_one(self) -> None:
        found = scenes.load("couette", level=2).run(progress=False).observables
        assert found["torque"][-1] == pytest.approx(found["exact_torque"][-1], rel=1e-2)

    def test_multigrid_gives_the_flow_of_the_direct_solver(self) -> None:
        direct, cycled = (
            scenes.load("couette", level=2, linear_solver=solver).run(progress=False).observables
            for solver in ("direct", "multigrid")
        )
        assert cycled["multigrid_cycles"][-1] >= 1.0 and direct["multigrid_cycles"][-1] == 0.0
        np.testing.assert_allclose(
            cycled["cut_speed"], direct["cut_speed"], atol=1e-6 * direct["cut_speed"].max()
        )


class TestCavity:
    def test_a_newtonian_fluid_has_the_known_vortex(self) -> None:
        run = scenes.load("cavity", bingham=0.0, cells=16).run(progress=False)
        assert run.summary["vortex_x"] == pytest.approx(0.5, abs=1e-3)
        assert run.summary["vortex_y"] == pytest.approx(0.765, abs=3e-3)
        assert run.summary["vortex_strength"] == pytest.approx(-0.1001, abs=5e-4)
        assert run.summary["plug_area"] == 0.0

    def test_a_yield_stress_lifts_the_vortex_and_makes_plugs(self) -> None:
        soft, stiff = (
            scenes.load("cavity", bingham=b, cells=8).run(progress=False).summary for b in (1.0, 10.0)
        )
        assert soft["vortex_y"] < stiff["vortex_y"]
        assert 0.0 < soft["plug_area"] < stiff["plug_area"] < 1.0


class TestStreamFunction:
    def test_it_is_exact_for_a_quadratic_one(self) -> None:
        space = QuadraticSpace(QuadraticMesh.of(rectangle((0.0, 0.0), (1.0, 1.0), (4, 4), "quadrilateral")))
        x, y = space.mesh.nodes.T
        psi = x * (1.0 - x) * y * (1.0 - y)
        velocity = np.stack([x * (1.0 - x) * (1.0 - 2.0 * y), -(1.0 - 2.0 * x) * y * (1.0 - y)], axis=1)
        assert stream_function(space, velocity) == pytest.approx(psi, abs=1e-12)
        place, value = vortex(space, velocity)
        assert place == pytest.approx((0.5, 0.5), abs=1e-9)
        assert value == pytest.approx(0.0625, rel=1e-2)


@pytest.mark.parametrize(
    ("scene", "overrides", "field"),
    [
        ("cylinder_dfg", {"fluid": "newtonian", "tau0": 1.0}, "material.tau0"),
        ("cylinder_dfg", {"fluid": "bingham", "exponent": 3.0}, "material.exponent"),
        ("couette", {"shape": "triangle", "linear_solver": "multigrid"}, "elements.shape"),
        ("couette", {"pressures": "P1"}, "elements.pressures"),
        ("cavity", {"elements.pressures": "P1"}, "elements.pressures"),
        ("couette", {"outer": 0.01}, "geometry.outer"),
    ],
)
def test_what_does_not_fit_together_is_refused(scene: str, overrides: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as caught:
        scenes.load(scene, **overrides)
    assert caught.value.field == field
