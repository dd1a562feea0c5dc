"""The Bingham cavity solved two ways: one fluid, profiles that come to each other, rigid zones that only one of them has."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan import reproductions, scenes
from barchan.flows.dense import Material
from barchan.flows.quasi_newtonian.models import Bingham
from barchan.reproductions import bingham_cavity
from barchan.reproductions.workshop import Finished, Job, Workshop


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[object, Finished]:
    """Bi = 5 by eps; 0 without regularisation, "newtonian" and "stokes" without yield stress."""
    jobs = {
        0.0: Job(
            "nonsmooth", "cavity_bingham", {"bingham": 5.0, "cells": 12, "tolerance": bingham_cavity.EXACT}
        ),
        1e-1: Job("mild", "cavity", {"bingham": 5.0, "cells": 12, "eps": 1e-1}),
        1e-3: Job("sharp", "cavity", {"bingham": 5.0, "cells": 12, "eps": 1e-3}),
        "stokes": Job("stokes", "cavity_bingham", {"bingham": 0.0, "cells": 8}),
        "newtonian": Job("newtonian", "cavity", {"bingham": 0.0, "cells": 8}),
    }
    finished = Workshop(tmp_path_factory.mktemp("cavity")).run(list(jobs.values()))
    return dict(zip(jobs, finished, strict=True))


class TestOneFluid:
    @given(rate=st.floats(1e-3, 1e3), bingham=st.floats(0.1, 50.0))
    def test_simple_shear_bears_the_same_stress(self, rate: float, bingham: float) -> None:
        """tau = eta du/dy + tau0 in both rooms: sqrt(J2) bounded by tau0 there, |sigma| by sqrt(2) tau0 here."""
        law = Material(bingham=bingham).law_at(np.zeros((1, 2)))
        nonsmooth = rate + float(law.parameters(1)[0, 1])
        g = np.array([0.5 * rate])  # the component xy of D(u); |g|^2 counts it twice
        eta = Bingham(1.0, bingham, 1e-12).viscosity(2.0 * g**2, np.zeros(1))
        assert float((2.0 * eta * g)[0]) == pytest.approx(nonsmooth, rel=1e-9)

    def test_without_yield_stress_both_are_the_flow_of_stokes(self, runs: dict[object, Finished]) -> None:
        differences = bingham_cavity.profile_differences(runs["stokes"], runs["newtonian"])
        assert max(differences) < 5e-3


class TestRegularisation:
    @given(bingham=st.floats(0.5, 50.0), eps=st.floats(1e-6, 1e-3))
    def test_the_stress_reaches_the_yield_stress_at_the_rate_that_is_said(
        self, bingham: float, eps: float
    ) -> None:
        rate = np.array([bingham_cavity.yield_rate(bingham, eps)])
        below, at, above = (
            float(bingham_cavity.stress_share(f * rate, bingham, eps)[0]) for f in (0.9, 1.0, 1.1)
        )
        assert below < 1.0 < above
        assert abs(at - 1.0) < 0.1 * (above - below)

    def test_the_share_of_the_yield_stress_is_that_of_the_model(self) -> None:
        g, bingham, eps = np.array([1e-4, 1e-2, 1.0]), 3.0, 1e-3
        stress = 2.0 * g * Bingham(1.0, bingham, eps).viscosity(g**2 + eps**2, np.zeros(3))
        assert bingham_cavity.stress_share(g, bingham, eps) == pytest.approx(
            stress / (np.sqrt(2.0) * bingham)
        )

    def test_profiles_come_to_the_nonsmooth_ones(self, runs: dict[object, Finished]) -> None:
        mild, sharp = (bingham_cavity.profile_differences(runs[0.0], runs[eps]) for eps in (1e-1, 1e-3))
        assert sharp[0] < 0.6 * mild[0] and sharp[1] < 0.3 * mild[1]
        assert max(sharp) < 1.5e-2

    def test_only_the_nonsmooth_flow_has_zones_without_shear(self, runs: dict[object, Finished]) -> None:
        rigid = runs[0.0].results.fields(-1)["shear_rates"] < bingham_cavity.RIGID_RATE
        assert np.mean(rigid) > 0.3
        for eps in (1e-1, 1e-3):
            slow = runs[eps].results.fields(-1)["shear_rates"] < bingham_cavity.RIGID_RATE
            assert np.mean(slow) < 0.03


@pytest.mark.parametrize("bi", bingham_cavity.SHOWN)
def test_the_vortex_of_a_coarse_mesh_is_near_the_published_one(bi: float) -> None:
    run = scenes.load("cavity", bingham=bi, cells=16, eps=1e-3).run(progress=False)
    assert abs(run.summary["vortex_strength"]) == pytest.approx(bingham_cavity.VORTEX[bi], rel=0.03)


def test_the_reproduction_leaves_tables_and_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bingham_cavity, "QUICK_CELLS", (4, 8))
    report = reproductions.reproduce("bingham_cavity", tmp_path, quick=True, processes=1)
    assert report.converged
    assert {path.name for path in tmp_path.iterdir()} == {
        "cavity.csv",
        "profiles.png",
        "yield_surfaces.png",
        "runs",
    }
    with (tmp_path / "cavity.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["eps"] for row in rows} == {"0.0", "0.1", "0.001"}
    columns = [len(table.columns) for table in report.tables]
    assert all(
        len(row) == count for table, count in zip(report.tables, columns, strict=True) for row in table.rows
    )
