"""Granular columns, long runs: what seed B 7.2.3 and 7.5.1 report and what the laws of nature demand of the presets."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import barchan as bc

pytestmark = pytest.mark.slow
EXAMPLE = Path(__file__).parents[2] / "examples" / "column_run_out.py"


@pytest.fixture(scope="module")
def columns() -> ModuleType:
    """The example that runs columns."""
    spec = importlib.util.spec_from_file_location("column_run_out", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_gravel_column_comes_to_rest(tmp_path: Path) -> None:
    run = bc.scenes.load("collapse").run(out=tmp_path / "run", progress=False)
    steps, summary = run.results.steps, run.summary
    assert summary["converged"] and summary["worst_certificate"] <= 1e-4
    late = steps["time"] >= 0.9 * steps["time"][-1]
    assert steps["max_speed"][late].max() < 1e-4 * math.sqrt(9.81 * 0.1138)
    energy = steps["kinetic_energy"] + steps["potential_energy"]
    assert np.diff(energy).max() <= 1e-6 * energy[0]
    assert abs(summary["volume_drift"]) <= 1e-12
    assert steps["max_volume_fraction"].max() < 1.1
    fractions = steps["max_volume_fraction"][late]
    assert fractions[-1] <= fractions[0] + 1e-3
    angle = math.degrees(math.asin(0.65))
    assert 0.4 * angle < summary["slope_mean"] < summary["slope_steepest"] <= angle + 3.0


def test_run_out_grows_with_the_aspect_ratio_as_the_seed_says(columns: ModuleType) -> None:
    found = [columns.run_out(a, columns.RATE_LAW, 12)["run_out_bulk"] for a in (1.0, 2.0)]
    for a, run_out in zip((1.0, 2.0), found, strict=True):
        assert run_out == pytest.approx(1.82 * a**1.1, rel=0.2)


def test_rougher_columns_run_less_far_and_heap_steeper(columns: ModuleType) -> None:
    frictions = (0.3, 0.45, 0.6)
    found = [columns.run_out(1.0, {"friction": mu}, 12) for mu in frictions]
    reach = [f["run_out_bulk"] for f in found]
    assert reach[0] > reach[1] > reach[2]
    slopes = [f["slope_steepest"] for f in found]
    assert slopes[0] < slopes[1] < slopes[2]
    for mu, slope in zip(frictions, slopes, strict=True):
        assert slope <= math.degrees(math.asin(mu)) + 3.0
