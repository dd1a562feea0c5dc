"""Heights seen from above conserve volume and find flat tops; outlines of cones, craters and squares are what they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan.results.heaps import HeightMap, height_map, outline_of

SIZE, CELLS = [1.0, 0.8, 0.5], [20, 16, 10]


def cone(centre: tuple[float, float], radius: float, height: float, cells: int = 80) -> HeightMap:
    x = np.linspace(0.0, 1.0, cells + 1)
    away = np.hypot(x[:, None] - centre[0], x[None, :] - centre[1])
    return HeightMap(x, x, np.maximum(height * (1.0 - away / radius), 0.0))


@given(seed=st.integers(0, 1000), packed=st.floats(0.3, 1.0))
def test_the_volume_under_the_map_is_that_of_the_particles(seed: int, packed: float) -> None:
    rng = np.random.default_rng(seed)
    positions, volumes = rng.uniform(0.0, 1.0, (50, 3)) * SIZE, rng.uniform(0.1, 1.0, 50)
    found = height_map(positions, volumes, SIZE, CELLS, packed)
    widths = [np.full(n + 1, length / n) for n, length in zip(CELLS[:2], SIZE[:2], strict=True)]
    for width in widths:
        width[[0, -1]] *= 0.5
    ground = widths[0][:, None] * widths[1][None, :]
    assert np.sum(found.height * ground) * packed == pytest.approx(volumes.sum(), rel=1e-12)


def test_a_packed_layer_has_its_height_everywhere() -> None:
    axes = [
        (np.arange(n * 3) + 0.5) * length / (3 * n)
        for n, length in zip((20, 16, 4), (1.0, 0.8, 0.2), strict=True)
    ]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    found = height_map(positions, np.full(len(positions), 0.16 / len(positions)), SIZE, CELLS, 1.0)
    assert found.height == pytest.approx(0.2, rel=1e-12)
    assert found.smoothed().height == pytest.approx(0.2, rel=1e-12)


@given(x=st.floats(0.45, 0.55), y=st.floats(0.45, 0.55), radius=st.floats(0.25, 0.4))
def test_a_cone_is_round_wherever_it_stands(x: float, y: float, radius: float) -> None:
    line = outline_of(cone((x, y), radius, 0.3), (x, y), 0.1, "heap")
    assert line.whole
    assert line.mean_radius == pytest.approx(radius * 2.0 / 3.0, rel=5e-3)
    assert line.circularity < 1.01
    assert line.harmonic(4) < 5e-3


def test_the_hole_of_an_upturned_cone_is_its_crater() -> None:
    heap = cone((0.5, 0.5), 0.3, 0.2)
    crater = HeightMap(heap.x, heap.y, 0.2 - heap.height)
    line = outline_of(crater, (0.5, 0.5), 0.1, "crater")
    assert line.mean_radius == pytest.approx(0.15, rel=5e-3)
    assert line.circularity < 1.01


def test_a_square_shows_its_corners() -> None:
    x = np.linspace(0.0, 1.0, 101)
    away = np.maximum(np.abs(x[:, None] - 0.5), np.abs(x[None, :] - 0.5))
    line = outline_of(HeightMap(x, x, np.maximum(0.3 - away, 0.0)), (0.5, 0.5), 0.1, "heap")
    assert line.circularity == pytest.approx(np.sqrt(2.0), rel=0.02)
    assert line.harmonic(4) > 0.05
    assert line.harmonic(3) < 1e-3


@pytest.mark.parametrize("kind", ["heap", "crater"])
def test_an_outline_that_leaves_the_box_is_not_whole(kind: str) -> None:
    flat = HeightMap(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5), np.full((5, 5), 0.2))
    line = outline_of(flat, (0.5, 0.5), 0.1 if kind == "heap" else 0.3, kind)  # type: ignore[arg-type]
    assert not line.whole
    assert np.isnan(line.circularity)
