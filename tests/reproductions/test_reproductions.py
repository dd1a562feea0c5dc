"""Fits recover the laws they are given, published tables are the published ones, finished runs are not run again."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan import reproductions
from barchan.errors import InputError
from barchan.reproductions import cylinder, poiseuille
from barchan.reproductions.fits import fit_exponent, fit_free, fit_law
from barchan.reproductions.workshop import Job, Workshop, published
from barchan.scenes import Scene

OUTLETS = np.array([0.5, 0.75, 1.0, 1.5, 2.0])
TINY = {"cells": 4, "length": 0.5}


class TestFits:
    @given(C=st.floats(0.5, 3.0), k=st.floats(0.0, 4.0))
    def test_a_beverloo_law_is_found_exactly(self, C: float, k: float) -> None:
        fit = fit_law(OUTLETS, C * (OUTLETS - k / 11.2) ** 1.5)
        assert (fit.factor, fit.k) == pytest.approx((C, k), abs=1e-9)
        assert fit.quality == pytest.approx(1.0)
        assert fit.worst < 1e-9

    @given(exponent=st.floats(0.8, 3.0), factor=st.floats(0.1, 5.0))
    def test_a_power_law_has_its_exponent(self, exponent: float, factor: float) -> None:
        assert fit_exponent(OUTLETS, factor * OUTLETS**exponent) == pytest.approx(exponent)

    @pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
    def test_the_free_exponent_tells_laws_apart(self, exponent: float) -> None:
        Q = 1.3 * (OUTLETS - 0.1) ** exponent
        assert fit_free(OUTLETS, Q).exponent == pytest.approx(exponent, abs=0.011)
        wrong = fit_law(OUTLETS, Q, exponent=exponent + 0.5)
        assert wrong.worst > 1e-3

    def test_a_discharge_that_does_not_grow_has_no_law(self) -> None:
        assert fit_law(OUTLETS, 2.0 - 0.1 * OUTLETS).quality == 0.0


class TestPublished:
    @pytest.mark.parametrize("name", ["beverloo", "silo_solver_timings"])
    def test_the_tables_are_those_of_the_reference(self, name: str, shared_data: Path) -> None:
        lines = (shared_data / "reference" / f"{name}.csv").read_text().splitlines()
        theirs = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        assert published(name) == theirs


class TestCylinder:
    def test_the_axis_ahead_is_read_as_front_arch_and_dip(self) -> None:
        x = np.linspace(-1.0, 0.0, 101)
        # rises to 0.4 at -0.8, falls to 0.3 at -0.6, rises to 2 at -0.1, falls to 1.5 at the front
        pressure = np.interp(x, [-1.0, -0.8, -0.6, -0.1, 0.0], [0.0, 0.4, 0.3, 2.0, 1.5])
        assert cylinder._along_the_axis(x, pressure) == pytest.approx((1.5, 2.0, 0.1, 0.1))
        assert cylinder._along_the_axis(x, x + 1.0) == pytest.approx((1.0, 1.0, 0.0, 0.0))

    @given(mu=st.floats(0.0, 0.9))
    def test_a_radial_plastic_field_is_in_balance(self, mu: float) -> None:
        """sigma_r = r^(n - 1) and sigma_theta = n sigma_r are in balance, and yield with sin(phi) = mu."""
        n = cylinder.radial_exponent(mu)
        r, step = 0.7, 1e-5
        slope = ((r + step) ** n - (r - step) ** n) / (2.0 * step)
        assert slope == pytest.approx(n * r ** (n - 1.0), rel=1e-6)
        assert (1.0 - n) / (1.0 + n) == pytest.approx(mu)

    @given(n=st.floats(0.1, 2.0), factor=st.floats(0.1, 5.0))
    def test_a_power_of_the_diameter_has_its_exponent(self, n: float, factor: float) -> None:
        assert cylinder._exponent(factor * np.array(cylinder.DIAMETERS) ** n) == pytest.approx(n)
        assert np.isnan(cylinder._exponent(np.array([1.0, np.nan, 2.0])))


class TestWorkshop:
    @pytest.mark.parametrize("processes", [1, 2])
    def test_finished_runs_are_found_again(
        self, tmp_path: Path, processes: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        jobs = [Job(f"bi-{bi:g}", "poiseuille_bingham", {**TINY, "bingham": bi}) for bi in (0.0, 0.5)]
        first = Workshop(tmp_path, processes=processes).run(jobs)

        def forbidden(*_: object) -> None:
            raise AssertionError("a finished scene was run again")

        monkeypatch.setattr(Scene, "_run_frames", forbidden)
        again = Workshop(tmp_path, processes=1).run(jobs)
        assert [run.summary["peak"] for run in again] == [run.summary["peak"] for run in first]
        assert first[0].summary["peak"] > first[1].summary["peak"]

    def test_another_scene_never_takes_the_place_of_a_run(self, tmp_path: Path) -> None:
        workshop = Workshop(tmp_path)
        (one,) = workshop.run([Job("same", "poiseuille_bingham", {**TINY, "bingham": 0.0})])
        (other,) = workshop.run([Job("same", "poiseuille_bingham", {**TINY, "bingham": 0.5})])
        assert one.summary["peak"] != other.summary["peak"]

    def test_a_file_is_no_folder(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match="must be a folder"):
            Workshop(tmp_path / "file")


def test_orders_of_convergence_are_slopes() -> None:
    assert poiseuille.order_of((4, 8, 16), [1.0, 0.25, 0.0625]) == pytest.approx(2.0)


def test_every_reproduction_has_a_title_that_names_its_figure_or_table() -> None:
    assert all(re.search("Fig[.]|Table", reproductions.title(name)) for name in reproductions.NAMES)
    with pytest.raises(InputError, match="one of poiseuille"):
        reproductions.title("navier")


def test_the_poiseuille_reproduction_leaves_tables_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(poiseuille, "REFINEMENTS", (3, 5, 9, 17))
    monkeypatch.setattr(poiseuille, "PAIRS", (("P2", "P1d"),))
    report = reproductions.reproduce("poiseuille", tmp_path, quick=True, processes=1)
    assert report.converged
    assert {"errors.csv", "profiles.csv", "poiseuille.png", "runs"} == {
        path.name for path in tmp_path.iterdir()
    }
    with (tmp_path / "errors.csv").open() as file:
        errors = {(row["Bi"], row["cells"]): float(row["error_max"]) for row in csv.DictReader(file)}
    for bingham in ("0.5", "0.9"):
        assert errors[bingham, "9"] < errors[bingham, "3"]
