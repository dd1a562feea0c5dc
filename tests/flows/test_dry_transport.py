"""Transport of the volume fraction and of momentum on a mesh: bounds, conservation, means (seed B, 7.2.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from barchan.flows.dry import Cells, Options
from barchan.flows.dry._kernels import FREE, INNER, WALL
from barchan.flows.dry.transport import transport, within_capacity
from barchan.spaces.meshes import rectangle

CELLS = {
    kind: Cells.of(rectangle((0.0, 0.0), (1.0, 1.5), (5, 6), kind)) for kind in ("triangle", "quadrilateral")
}
KINDS = st.sampled_from(sorted(CELLS))
INERTIA = st.sampled_from(["explicit", "conservative"])
SEEDS = st.integers(0, 2**32 - 1)


def codes(cells: Cells, free: bool = False) -> np.ndarray:
    """Walls all round, or free boundaries."""
    return np.where(cells.neighbours < 0, FREE if free else WALL, INNER).astype(np.int64)


def random_matter(cells: Cells, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Fractions (c,), a third of them zero and some tiny, and velocities (c, d)."""
    rng = np.random.default_rng(seed)
    fractions = rng.random(cells.count) * 10.0 ** -rng.integers(0, 14, cells.count).astype(float)
    fractions[rng.random(cells.count) < 0.3] = 0.0
    fractions[rng.integers(cells.count)] = 0.7
    velocities = rng.normal(size=(cells.count, cells.dimension))
    velocities[fractions <= 1e-12] = 0.0
    return fractions, velocities


class TestVolumeFraction:
    @settings(max_examples=40, deadline=None)
    @given(KINDS, SEEDS, st.floats(1e-3, 30.0))
    def test_it_stays_between_zero_and_the_maximum_and_no_matter_is_lost(
        self, kind: str, seed: int, dt: float
    ) -> None:
        cells = CELLS[kind]
        fractions, velocities = random_matter(cells, seed)
        moved = transport(cells, codes(cells), fractions, velocities, dt, 0.8, Options())
        assert np.all(moved.fractions >= 0.0)
        assert np.all(moved.fractions <= 0.8)
        before = np.sum(fractions * cells.volumes)
        assert np.sum(moved.fractions * cells.volumes) == pytest.approx(before, rel=1e-13)

    @settings(max_examples=20, deadline=None)
    @given(KINDS, SEEDS, st.floats(1e-3, 3.0))
    def test_what_leaves_through_free_boundaries_is_counted(self, kind: str, seed: int, dt: float) -> None:
        cells = CELLS[kind]
        fractions, velocities = random_matter(cells, seed)
        moved = transport(cells, codes(cells, free=True), fractions, velocities, dt, 1.0, Options())
        left = np.sum(moved.fractions * cells.volumes)
        assert left + moved.gone == pytest.approx(np.sum(fractions * cells.volumes), rel=1e-13)
        assert moved.gone >= 0.0

    @settings(max_examples=30, deadline=None)
    @given(KINDS, SEEDS, st.floats(0.01, 2.0))
    def test_a_flow_that_nowhere_compresses_packed_matter_needs_no_limiter(
        self, kind: str, seed: int, dt: float
    ) -> None:
        """The bound phi (k+1) <= phi_max wherever 1 + dt div u >= phi / phi_max, as the momentum step demands."""
        cells = CELLS[kind]
        rng = np.random.default_rng(seed)
        fractions = 0.2 + 0.8 * rng.random(cells.count)
        velocities = rng.normal(size=(cells.count, 2))
        # Choose the fractions so that the demand holds: side velocities depend on them, hence a few rounds.
        for _ in range(60):
            divergence = side_divergence(cells, fractions, velocities)
            fractions = np.minimum(fractions, np.maximum(1.0 + dt * divergence, 1e-3))
            velocities *= np.where(np.max(fractions - 1.0 - dt * divergence) > 0.0, 0.8, 1.0)
        assume(np.max(fractions - 1.0 - dt * side_divergence(cells, fractions, velocities)) <= 0.0)
        moved = transport(cells, codes(cells), fractions, velocities, dt, np.inf, Options())
        assert np.max(moved.fractions) <= 1.0 + 1e-12

    def test_an_empty_cell_upstream_stays_empty_where_the_centred_scheme_goes_negative(self) -> None:
        """Fig. 7.4: matter leaves one cell, and nothing is taken from its empty neighbour behind."""
        cells = CELLS["triangle"]
        fractions, velocities = np.zeros(cells.count), np.zeros((cells.count, 2))
        start = int(np.argmin(np.linalg.norm(cells.centres - [0.5, 0.7], axis=1)))
        fractions[start], velocities[start] = 1.0, (0.0, 1.0)
        moved = transport(cells, codes(cells), fractions, velocities, 0.1, 1.0, Options())
        assert np.min(moved.fractions) == 0.0
        heights = cells.centres[:, 1]
        assert moved.fractions @ (cells.volumes * heights) > fractions @ (cells.volumes * heights)


class TestMomentum:
    @settings(max_examples=30, deadline=None)
    @given(KINDS, SEEDS, st.floats(1e-3, 5.0), INERTIA)
    def test_velocities_are_means_of_velocities(self, kind: str, seed: int, dt: float, inertia: str) -> None:
        cells = CELLS[kind]
        fractions, velocities = random_matter(cells, seed)
        options = replace(Options(), inertia=inertia)
        moved = transport(cells, codes(cells), fractions, velocities, dt, 1.0, options)
        filled = fractions > 1e-12
        low, high = velocities[filled].min(axis=0), velocities[filled].max(axis=0)
        there = moved.fractions > 1e-11
        assert np.all(moved.carried[there] >= np.minimum(low, 0.0) - 1e-9)
        assert np.all(moved.carried[there] <= np.maximum(high, 0.0) + 1e-9)

    @settings(max_examples=30, deadline=None)
    @given(KINDS, SEEDS, INERTIA)
    def test_total_momentum_is_kept(self, kind: str, seed: int, inertia: str) -> None:
        cells = CELLS[kind]
        rng = np.random.default_rng(seed)
        fractions, velocities = 0.3 + 0.4 * rng.random(cells.count), rng.normal(size=(cells.count, 2))
        options = replace(Options(), inertia=inertia)
        # A step in which no cell is emptied: the explicit form then keeps momentum to round-off.
        moved = transport(cells, codes(cells), fractions, velocities, 0.01, 10.0, options)
        before = (fractions * cells.volumes) @ velocities
        assert (moved.fractions * cells.volumes) @ moved.carried == pytest.approx(before, abs=1e-13)

    def test_dust_that_falls_on_a_heap_does_not_push_it(self) -> None:
        """The unweighted form of the seed would give the heap a velocity that does not depend on the weight of the dust."""
        cells = CELLS["quadrilateral"]
        heap = cells.centres[:, 1] < 0.75
        fractions = np.where(heap, 1.0, 1e-6)
        velocities = np.where(heap[:, None], [0.0, 0.0], [0.0, -2.0])
        moved = transport(cells, codes(cells), fractions, velocities, 0.05, 1.0, Options())
        assert np.max(np.abs(moved.carried[heap])) < 1e-5


class TestExcess:
    def test_it_goes_to_the_nearest_room(self) -> None:
        cells = CELLS["quadrilateral"]
        fractions = np.ones(cells.count)
        full = int(np.argmin(np.linalg.norm(cells.centres - [0.5, 0.25], axis=1)))
        fractions[full] = 1.25
        fractions[cells.centres[:, 1] > 1.0] = 0.0
        spread, excess = within_capacity(cells, fractions, 1.0)
        assert excess == pytest.approx(0.25 * cells.volumes[full])
        changed = np.flatnonzero(spread != fractions)
        assert set(changed) - {full} <= set(
            np.flatnonzero((cells.centres[:, 1] > 1.0) & (cells.centres[:, 1] < 1.3))
        )
        assert spread @ cells.volumes == pytest.approx(fractions @ cells.volumes, rel=1e-14)

    def test_a_domain_that_is_too_small_for_its_matter_keeps_it_all(self) -> None:
        cells = CELLS["triangle"]
        spread, _ = within_capacity(cells, np.full(cells.count, 1.1), 1.0)
        assert spread @ cells.volumes == pytest.approx(1.1 * np.sum(cells.volumes), rel=1e-13)


def side_divergence(cells: Cells, fractions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """(c,) sum_F u_F . a_F / |K| with the velocity of the cell itself at walls, as in the strain rate."""
    other = np.maximum(cells.neighbours, 0)
    inside = (cells.neighbours >= 0)[..., None]
    own, theirs = fractions[:, None, None], fractions[other][..., None]
    mean = (own * velocities[:, None] + theirs * velocities[other]) / (own + theirs)
    sides = np.where(inside, mean, 0.0)
    return np.sum(sides * cells.faces, axis=(1, 2)) / cells.volumes
