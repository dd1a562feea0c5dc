"""The free surface, slopes, fronts and verdicts are exact on shapes whose answers are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan import scenes
from barchan.scenes.granular.surface import Surface, free_surface
from barchan.scenes.kinds.column.observables import column_volume, geometry_observables, summarise

TABLES = {"box.size": [1.0, 0.5], "box.cells": [20, 10], "column.length": 0.2, "column.height": 0.4}
PARAMETERS = scenes.load("collapse", **TABLES).parameters


def lattice(
    lower: tuple[float, float], upper: tuple[float, float], per_metre: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and volumes of a regular lattice of particles filling a rectangle."""
    counts = [round((high - low) * per_metre) for low, high in zip(lower, upper, strict=True)]
    axes = [
        low + (np.arange(n) + 0.5) * (high - low) / n
        for low, high, n in zip(lower, upper, counts, strict=True)
    ]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    volume = (upper[0] - lower[0]) * (upper[1] - lower[1])
    return positions, np.full(len(positions), volume / len(positions))


def under_a_slope(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """A fine lattice of particles below the line from (0, 0.4) downwards at an angle."""
    positions, volumes = lattice((0.0, 0.0), (1.0, 0.4), 400)
    below = positions[:, 1] < 0.4 - math.tan(math.radians(degrees)) * positions[:, 0]
    return positions[below], volumes[below]


class TestFreeSurface:
    @given(shift=st.floats(0.0, 0.3), height=st.floats(0.05, 0.5))
    def test_a_packed_lattice_has_its_height_wherever_it_lies_in_the_grid(
        self, shift: float, height: float
    ) -> None:
        # four particles to a cell along x: hat functions sum up exactly over such a lattice
        positions, volumes = lattice((shift, 0.0), (shift + 0.6, height), 80)
        surface = free_surface(positions, volumes, [1.0, 0.5], [20, 10], 1.0)
        inside = (surface.x >= shift + 0.05) & (surface.x <= shift + 0.55)
        assert surface.height[inside] == pytest.approx(height, rel=1e-9)

    def test_heights_at_walls_count_half_cells(self) -> None:
        positions, volumes = lattice((0.0, 0.0), (1.0, 0.3), 80)
        assert free_surface(positions, volumes, [1.0, 0.5], [20, 10], 1.0).height == pytest.approx(0.3)

    @given(seed=st.integers(0, 1000), fraction=st.floats(0.3, 1.0))
    def test_the_volume_below_the_surface_is_that_of_the_particles(self, seed: int, fraction: float) -> None:
        rng = np.random.default_rng(seed)
        positions, volumes = rng.random((200, 3)) * [1.0, 0.2, 0.5], rng.random(200) * 1e-4
        surface = free_surface(positions, volumes, [1.0, 0.2, 0.5], [20, 4, 10], fraction)
        area = np.trapezoid(surface.height, surface.x)
        assert area * 0.2 * fraction == pytest.approx(volumes.sum(), rel=1e-12)

    @pytest.mark.parametrize("degrees", [5.0, 15.0, 25.0, 35.0])
    def test_a_plane_slope_has_its_angle(self, degrees: float) -> None:
        positions, volumes = under_a_slope(degrees)
        surface = free_surface(positions, volumes, [1.0, 0.5], [20, 10], 1.0)
        assert surface.mean_slope() == pytest.approx(degrees, abs=0.6)
        assert surface.steepest_slope(0.05) == pytest.approx(degrees, abs=1.0)

    def test_level_ground_and_an_empty_box_have_no_slope(self) -> None:
        x = np.linspace(0.0, 1.0, 21)
        assert Surface(x, np.full(21, 0.3)).steepest_slope(0.05) == pytest.approx(0.0, abs=1e-9)
        assert Surface(x, np.zeros(21)).steepest_slope(0.05) == 0.0
        assert Surface(x, np.zeros(21)).mean_slope() == 0.0

    def test_a_thin_toe_does_not_count_as_slope(self) -> None:
        x = np.linspace(0.0, 1.0, 21)
        toe = np.where(x < 0.5, 0.04, 0.0)
        assert Surface(x, toe).steepest_slope(0.05) == 0.0


class TestColumn:
    def test_the_initial_column_has_no_run_out_and_full_height(self) -> None:
        positions, volumes = lattice((0.0, 0.0), (0.2, 0.4), 200)
        values = geometry_observables(PARAMETERS, positions, volumes)
        assert volumes.sum() == pytest.approx(column_volume(PARAMETERS))
        assert values["run_out"] == pytest.approx(0.0, abs=0.02)
        assert values["height_ratio"] == pytest.approx(1.0)
        assert values["height_back"] == pytest.approx(0.4)
        assert values["top"] == pytest.approx(0.4, abs=0.01)

    def test_run_out_follows_the_definition(self) -> None:
        positions, volumes = lattice((0.0, 0.0), (0.8, 0.1), 200)
        values = geometry_observables(PARAMETERS, positions, volumes)
        assert values["run_out"] == pytest.approx(3.0, rel=0.01)
        assert values["height_ratio"] == pytest.approx(0.25)

    def test_single_grains_rolling_ahead_move_the_front_but_not_its_bulk(self) -> None:
        positions, volumes = lattice((0.0, 0.0), (0.4, 0.2), 200)
        positions[0] = 0.95, 0.01
        values = geometry_observables(PARAMETERS, positions, volumes)
        assert values["front"] == 0.95
        assert values["front_bulk"] == pytest.approx(0.4, abs=0.01)


def records(speeds: list[float], energies: list[float], **others: Any) -> dict[str, np.ndarray]:
    count = len(speeds)
    steps: dict[str, Any] = {
        "time": np.arange(1, count + 1) * 0.1,
        "max_speed": np.array(speeds),
        "kinetic_energy": np.zeros(count),
        "potential_energy": np.array(energies),
        "total_volume": np.full(count, 0.08),
        "max_volume_fraction": np.linspace(1.0, 1.05, count),
        "residual": np.full(count, 1e-5),
        "converged": np.full(count, True),
        "sweeps": np.full(count, 7),
    }
    return {**steps, **others}


FRAME = geometry_observables(PARAMETERS, *lattice((0.0, 0.0), (0.8, 0.1), 200))
START = {"time": 0.0, "kinetic_energy": 0.0, "potential_energy": 10.0, "volume": 0.08, **FRAME}
OBSERVABLES = {name: np.array([value, value]) for name, value in START.items()}


class TestSummary:
    def summary(self, steps: dict[str, np.ndarray]) -> dict[str, Any]:
        return summarise(PARAMETERS, steps, OBSERVABLES)

    def test_rest_begins_with_the_first_of_the_steps_that_stay_slow(self) -> None:
        threshold = 1e-4 * math.sqrt(9.81 * 0.4)
        slow, fast = 0.5 * threshold, 2.0 * threshold
        resting = self.summary(records([fast, slow, fast, *[slow] * 17], [9.0] * 20))
        assert resting["at_rest"]
        assert resting["duration"] == pytest.approx(0.4)

    def test_rest_must_last_a_tenth_of_the_run(self) -> None:
        slow, fast = 0.0, 1.0
        late = self.summary(records([fast] * 19 + [slow], [9.0] * 20))
        assert not late["at_rest"]
        assert late["duration"] == pytest.approx(2.0)
        never = self.summary(records([slow] * 19 + [fast], [9.0] * 20))
        assert (never["at_rest"], never["duration"]) == (False, None)

    def test_the_largest_rise_of_energy_is_relative_to_the_start(self) -> None:
        assert self.summary(records([1.0] * 4, [9.0, 8.0, 8.5, 8.4]))["largest_energy_rise"] == pytest.approx(
            0.05
        )
        assert self.summary(records([1.0] * 4, [10.1, 8.0, 7.0, 6.0]))[
            "largest_energy_rise"
        ] == pytest.approx(0.01)
        assert self.summary(records([1.0] * 4, [9.0, 8.0, 7.0, 6.0]))["largest_energy_rise"] == 0.0

    def test_worst_figures_over_the_steps(self) -> None:
        volumes = np.array([0.08, 0.08 * (1.0 + 1e-10), 0.08, 0.08])
        converged = np.array([True, False, True, True])
        residuals = np.array([1e-5, 3e-4, 1e-6, 1e-6])
        steps = records([1.0] * 4, [9.0] * 4, total_volume=volumes, converged=converged, residual=residuals)
        summary = self.summary(steps)
        assert summary["volume_drift"] == pytest.approx(1e-10, rel=1e-3)
        assert (summary["converged"], summary["unconverged_steps"]) == (False, 1)
        assert summary["worst_certificate"] == 3e-4
        assert summary["largest_volume_fraction"] == 1.05
        assert (summary["steps"], summary["sweeps"]) == (4, 28)
