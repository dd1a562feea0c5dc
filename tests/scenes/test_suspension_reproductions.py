"""Figures of grains inside a fluid: linear theory against exact limits, small reproductions that leave tables and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan import reproductions, scenes
from barchan.errors import InputError
from barchan.reproductions import immersed_columns, rayleigh_taylor, sedimentation, sedimentation_onset
from barchan.reproductions.two_fluids import TwoFluids
from barchan.reproductions.workshop import Finished, Workshop
from barchan.results.line_convolution import convolved_noise, direction_image

NAMES = ("rayleigh_taylor", "sedimentation", "sedimentation_onset", "immersed_columns")


class TestTwoFluids:
    @given(k=st.floats(0.5, 20.0), share=st.floats(0.2, 0.8), excess=st.floats(1.0, 1e4))
    @settings(max_examples=25, deadline=None)
    def test_without_inertia_between_slipping_plates_the_rate_is_a_series(
        self, k: float, share: float, excess: float
    ) -> None:
        """eta (D^2 - k^2)^2 w = (g k^2 [rho] / n) w(h) delta(z - h) in the sines of the gap."""
        H, eta = 1.3, 1e9
        m = np.arange(1, 4000) * np.pi / H
        series = (
            9.81 * k**2 * excess / eta * np.sum(2.0 / H * np.sin(m * share * H) ** 2 / (m**2 + k**2) ** 2)
        )
        fluids = TwoFluids(H, share * H, 1000.0, 1000.0 + excess, eta, stick_below=False, stick_above=False)
        assert fluids.growth_rate(k) == pytest.approx(series, rel=1e-5)

    def test_deep_ideal_fluids_grow_as_the_root_of_the_atwood_number(self) -> None:
        k = 2.0 * np.pi
        rate = TwoFluids(4.0, 2.0, 1000.0, 3000.0, 1e-3).growth_rate(k, elements=600)
        assert rate == pytest.approx(np.sqrt(9.81 * k * 0.5), rel=5e-3)

    def test_sticking_plates_hold_fluids_back(self) -> None:
        stick, slip = (
            TwoFluids(1.0, 0.5, 1000.0, 2000.0, 10.0, stick_below=s, stick_above=s).growth_rate(np.pi)
            for s in (True, False)
        )
        assert stick < slip

    def test_the_elements_are_fine_enough(self) -> None:
        fluids = TwoFluids(1.0, 0.5, 1000.0, 301000.0, 1e5)
        assert fluids.growth_rate(6.0, 50) == pytest.approx(fluids.growth_rate(6.0, 400), rel=1e-6)

    def test_a_heavy_fluid_below_is_stable(self) -> None:
        with pytest.raises(InputError, match="above"):
            TwoFluids(1.0, 0.5, 2000.0, 1000.0, 1.0).growth_rate(3.0)


class TestConvolution:
    def test_grey_values_vary_less_along_the_stream_than_across(self) -> None:
        grey = convolved_noise(np.ones((120, 120)), np.zeros((120, 120)))
        along, across = np.abs(np.diff(grey, axis=0)).mean(), np.abs(np.diff(grey, axis=1)).mean()
        assert along < 0.3 * across

    def test_fluid_at_rest_is_black_and_colours_are_colours(self) -> None:
        field = np.zeros((9, 7))
        image = direction_image(field, field, 1.0, pixels=60)
        assert image.shape == (45, 60, 3) and not image.any()
        image = direction_image(field + 1.0, field, 1.0, pixels=60)
        assert image.min() >= 0.0 and image.max() <= 1.0


class TestReproductions:
    def test_all_of_the_chapter_are_there(self) -> None:
        assert set(NAMES) <= set(reproductions.NAMES)
        assert all("seed B" in reproductions.title(name) for name in NAMES)

    @pytest.mark.parametrize("label", immersed_columns.FLUIDS)
    def test_columns_are_those_of_the_seed(self, label: str) -> None:
        overrides = immersed_columns.FLUIDS[label]
        parameters: Any = scenes.load("immersed_column", **overrides).parameters
        piece = parameters.matter.model_extra["column"]
        assert piece.size[1] / piece.size[0] == pytest.approx(8.0)
        assert piece.size[0] == pytest.approx(11.5e-3)
        assert parameters.grains.diameter <= min(parameters.spacing)
        grains = parameters.grains
        assert (grains.friction, grains.friction + grains.friction_increment) == pytest.approx((0.32, 0.6))

    def test_layers_alone_settle_as_the_closure_says_when_drag_wins(self, tmp_path: Path) -> None:
        scene = scenes.load(
            "sedimentation", **{"grains.diameter": 1e-4, "box.cells": [4, 4], "time.end": 0.2, "per_cell": 1}
        )
        run = scene.run(tmp_path / "run", progress=False, pictures=False)
        speed = 1500.0 * 9.81 * 1e-8 / 18e-3 * 0.82**4.65
        expected = 0.9 * 0.7 / speed / run.summary["time_unit"]
        found = sedimentation_onset.free_settling(Finished(run.summary, run.observables, run.results))
        assert found == pytest.approx(expected, rel=1e-2)

    def test_a_small_instability_grows_as_theory_says(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        tiny = {"box.cells": [12, 12], "per_cell": 2, "time.step": 0.05, "time.end": 2.0}
        monkeypatch.setattr(rayleigh_taylor, "COARSE", tiny)
        monkeypatch.setattr(rayleigh_taylor, "EXCESSES", (10.0,))
        report = rayleigh_taylor.reproduce(Workshop(tmp_path, quick=True))
        (row,) = report.tables[0].rows
        assert report.converged
        assert float(row[3]) == pytest.approx(float(row[2]), rel=0.1)
        assert {"growth.png", "rayleigh_taylor.png", "growth.csv"} <= {p.name for p in tmp_path.iterdir()}

    def test_small_sedimentations_leave_tables_and_pictures(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        tiny = {"box.cells": [8, 8], "per_cell": 2, "time.step": 0.05, "time.end": 0.4}
        monkeypatch.setattr(sedimentation, "COARSE", tiny)
        monkeypatch.setattr(sedimentation_onset, "COARSE", tiny)
        first = sedimentation.reproduce(Workshop(tmp_path / "a", quick=True))
        second = sedimentation_onset.reproduce(Workshop(tmp_path / "b", quick=True))
        assert first.converged and second.converged
        assert len(second.tables[0].rows) == len(sedimentation_onset.GRAINS)
        assert (tmp_path / "a" / "sedimentation.png").exists() and (tmp_path / "a" / "layers.csv").exists()
        assert (tmp_path / "b" / "onset.png").exists() and (tmp_path / "b" / "centres.png").exists()

    def test_small_columns_leave_tables_and_pictures(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        tiny = {
            "box.cells": [28, 14],
            "per_cell": 1,
            "time.step": 0.005,
            "time.end": 0.05,
            "time.frame_rate": 40.0,
        }
        monkeypatch.setattr(immersed_columns, "COARSE", tiny)
        report = immersed_columns.reproduce(Workshop(tmp_path, quick=True))
        assert [row[0] for row in report.tables[0].rows] == list(immersed_columns.FLUIDS)
        assert {"fronts.png", "columns.png", "triple.png"} <= {p.name for p in tmp_path.iterdir()}
