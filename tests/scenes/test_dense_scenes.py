"""The scenes of dense flows against exact solutions and laws of nature (seed A 6.1, ERRATA 2)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import barchan as bc


def run_of(name: str, **overrides: Any) -> bc.scenes.Run:
    return bc.scenes.load(name, **overrides).run(out=None, progress=False)


class TestPoiseuille:
    @pytest.mark.parametrize("bingham", [0.0, 0.1, 0.5, 0.9])
    def test_the_profile_is_the_exact_one(self, bingham: float) -> None:
        run = run_of("poiseuille_bingham", bingham=bingham, cells=20, length=0.2)
        y, ux = run.observables["profile_y"], run.observables["profile_ux"]
        # 20 cells have a vertex at the edge of each of these plugs: the exact velocity is in the space
        beyond = np.maximum(np.abs(y) - bingham, 0.0)
        exact = 0.5 * ((1.0 - bingham) ** 2 - beyond**2)
        assert np.abs(ux - exact).max() < 1e-3 * exact.max()
        assert run.summary["plug_width"] == pytest.approx(2.0 * bingham, abs=0.025)

    def test_nothing_flows_when_the_yield_stress_bears_the_weight(self) -> None:
        assert run_of("poiseuille_bingham", bingham=1.1, cells=8, tolerance=1e-8).summary["max_speed"] < 1e-8


class TestBagnold:
    def test_the_profiles_of_velocity_and_shear_rate(self) -> None:
        run = run_of("bagnold", cells=8)
        y = run.observables["profile_y"]
        angle = math.atan(0.55)
        steepest = math.sqrt(2.0 * (math.sin(angle) - 0.5 * math.cos(angle)))
        exact = 2.0 / 3.0 * steepest * (1.0 - (1.0 - y) ** 1.5)
        assert np.abs(run.observables["profile_ux"] - exact).max() < 1e-3 * exact.max()
        rate = steepest * np.sqrt(1.0 - y)
        assert np.abs(run.observables["profile_shear_rate"] - rate).max() < 0.05 * steepest

    def test_constant_viscosity_gives_a_parabola(self) -> None:
        run = run_of("bagnold", cells=4, viscosity="constant")
        assert run.summary["velocity_error"] < 1e-4

    @pytest.mark.parametrize("viscosity", ["rate", "constant"])
    def test_below_the_angle_of_friction_nothing_moves(self, viscosity: str) -> None:
        run = run_of("bagnold", cells=4, angle=0.4, viscosity=viscosity)
        assert run.summary["max_speed"] < 1e-8


class TestCavity:
    def test_stokes_flow_has_its_known_vortex(self) -> None:
        run = run_of("cavity_bingham", bingham=0.0, cells=16)
        assert run.summary["vortex_x"] == pytest.approx(0.5, abs=0.005)
        assert run.summary["vortex_y"] == pytest.approx(0.765, abs=0.005)
        assert run.summary["centreline_min"] == pytest.approx(-0.2087, abs=0.002)
        assert run.summary["centreline_min_y"] == pytest.approx(0.535, abs=0.01)
        assert run.summary["plug_area"] == 0.0

    @pytest.mark.slow
    def test_a_yield_stress_lifts_the_vortex_and_grows_plugs(self) -> None:
        soft, stiff = (run_of("cavity_bingham", bingham=bingham, cells=16) for bingham in (2.0, 20.0))
        assert 0.765 < soft.summary["vortex_y"] < stiff.summary["vortex_y"] < 1.0
        assert 0.0 < soft.summary["plug_area"] < stiff.summary["plug_area"]

    def test_the_lid_carries_the_fluid_along_the_whole_side(self) -> None:
        run = run_of("cavity_bingham", bingham=0.0, cells=8)
        assert run.observables["centreline_ux"][[0, -1]] == pytest.approx([0.0, 1.0])
        # what passes x = 1/2 to the right passes it to the left
        flux = np.trapezoid(run.observables["centreline_ux"], run.observables["centreline_y"])
        assert abs(flux) < 1e-3


class TestSilo:
    def test_the_discharge_is_that_of_the_jet(self) -> None:
        run = run_of("silo", mu=0.5, reynolds=1, bingham=0, outlet=1.0, vertices=100, tolerance=1e-3)
        lines = run.observables
        through = -2.0 * np.trapezoid(lines["outlet_uy"], lines["outlet_x"])
        assert lines["discharge"][0] == 0.0
        assert lines["discharge"][-1] == pytest.approx(through, rel=1e-3)

    @pytest.mark.slow
    def test_creeping_flow_is_proportional_to_the_reynolds_number(self) -> None:
        slow, fast = (
            run_of("silo", reynolds=re, vertices=60, tolerance=1e-5).summary["discharge"] for re in (1, 10)
        )
        assert fast == pytest.approx(10.0 * slow, rel=1e-2)

    @pytest.mark.slow
    def test_friction_and_yield_stress_slow_the_discharge(self) -> None:
        base = {"vertices": 60, "tolerance": 1e-4}
        free = run_of("silo", mu=0.1, **base).summary["discharge"]
        rough = run_of("silo", mu=0.5, **base).summary["discharge"]
        stiff = run_of("silo", mu=0.1, bingham=0.05, **base).summary["discharge"]
        assert 0.0 < rough < free and 0.0 < stiff < free


class TestCylinder:
    def test_nothing_flows_against_a_pressure_that_bears_the_weight(self) -> None:
        run = run_of("cylinder", mu=0.5, external_pressure=3.0, vertices=100, sides="no_slip", tolerance=1e-8)
        assert abs(run.summary["mean_velocity"]) < 1e-6

    def test_the_pressure_vanishes_in_the_wake(self) -> None:
        run = run_of("cylinder", sides="free_slip", external_pressure=1.7, vertices=300, tolerance=1e-5)
        found = run.summary
        assert found["mean_velocity"] > 0.1
        assert found["wake_pressure"] < 1e-5 < 1e-1 < found["front_pressure"] < found["max_pressure"]
        # the wake is a region with an end, and matter in the zone ahead of the cylinder does not yield
        assert 0.1 < found["wake_length"] / 0.25 < 2.0
        assert found["rigid_area_ahead"] > 0.0

    def test_the_drag_is_that_of_contacts_and_viscosity_and_hardly_depends_on_the_speed(self) -> None:
        slow, fast = (
            run_of("cylinder", mu=0.5, external_pressure=p, vertices=300, tolerance=1e-4).summary
            for p in (0.7, 0.5)
        )
        assert fast["mean_velocity"] > 2.0 * slow["mean_velocity"] > 0.0
        assert fast["drag"] == pytest.approx(slow["drag"], rel=0.15)
        for found in (slow, fast):
            parts = found["drag_contact"] + found["drag_viscous"]
            assert parts == pytest.approx(found["drag"], rel=0.02)
        assert fast["drag_viscous"] > slow["drag_viscous"] > 0.0
        assert fast["drag_coefficient"] < slow["drag_coefficient"] / 4.0
