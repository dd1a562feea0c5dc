"""A column of grains and the continuum that they calibrate come to rest alike (seed C, 3.3)."""

from __future__ import annotations

from pathlib import Path

import pytest

from barchan.reproductions import grains_to_fields
from barchan.reproductions.workshop import Workshop


@pytest.mark.slow
def test_discs_and_the_continuum_of_their_law_run_out_alike(tmp_path: Path) -> None:
    workshop = Workshop(tmp_path, quick=True, processes=2)
    report = grains_to_fields.reproduce(workshop)
    assert report.converged
    run_out, height = report.tables[-1].rows
    for row in (run_out, height):
        discs, continuum = float(row[1]), float(row[2])
        assert continuum == pytest.approx(discs, rel=0.15)
    assert float(run_out[1]) > 1.0
    for name in ("columns.png", "mu_of_i.png", "mu_of_i.csv"):
        assert (tmp_path / name).stat().st_size > 200
