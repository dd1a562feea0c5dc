"""Pictures of a run: they exist, are images of sensible size, show the moving matter, and stay small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from barchan.results import MemoryStore, Results, frame_tree, results_in_memory
from barchan.results.animation import LARGEST_SIZE, draw_animation
from barchan.results.pictures import draw_observables, draw_profile, draw_strip
from barchan.results.view import side_points, side_view, spread_frames


def sliding_block(dimension: int, frames: int = 12) -> Results:
    """A block of particles of 5 cm that slides by 2 cm a frame along x, faster the higher a particle lies."""
    axes = [np.linspace(0.005, 0.095, 10)] * dimension
    start = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
    store = MemoryStore()
    for k in range(frames):
        velocities = np.zeros_like(start)
        velocities[:, 0] = k * start[:, -1]
        particles = {
            "positions": start + np.eye(dimension)[0] * 0.02 * k,
            "velocities": velocities,
            "volumes": np.full(len(start), 0.01**dimension),
        }
        grid = {"node_ids": np.zeros(0, dtype=np.int64), "cells": np.zeros((0, 2**dimension), dtype=np.int32)}
        store.put_frame(k, frame_tree({"particles": particles, "grid": grid}, {}, {"time": 0.1 * k}))
    size = [1.0, 0.1, 0.2] if dimension == 3 else [1.0, 0.2]
    return results_in_memory(store, f"[box]\nsize = {size}\n")


@pytest.mark.parametrize("dimension", [2, 3])
def test_strip_and_animation(tmp_path: Path, dimension: int) -> None:
    run = sliding_block(dimension)
    draw_strip(tmp_path / "strip.png", run, 0.8, "a block")
    draw_animation(tmp_path / "block.gif", run, 0.8, "a block")
    with Image.open(tmp_path / "strip.png") as strip:
        assert strip.width > 1000
        colours = strip.convert("RGB").getcolors(maxcolors=1_000_000)
        assert colours is not None
        assert len(colours) > 50  # the colour scale and matter of several speeds
    with Image.open(tmp_path / "block.gif") as movie:
        assert movie.n_frames == len(spread_frames(run, 60, 0.8)) == 10
        sizes = {movie.size}
        for frame in range(movie.n_frames):
            movie.seek(frame)
            sizes.add(movie.size)
    assert len(sizes) == 1
    assert (tmp_path / "block.gif").stat().st_size <= LARGEST_SIZE


def test_the_window_holds_all_the_matter_and_stays_in_the_box() -> None:
    run = sliding_block(2)
    view = side_view(run, list(range(12)))
    assert 0.095 + 0.22 <= view.width <= 1.0
    assert 0.095 <= view.height <= 0.2
    assert view.grain == pytest.approx(0.0135)


def test_a_solid_run_is_seen_through_its_middle_and_the_fastest_lie_on_top() -> None:
    run = sliding_block(3)
    x, z, speeds = side_points(run, 3)
    assert len(x) == len(z) == 200  # two of ten layers
    assert np.all(np.diff(speeds) >= 0.0)


def test_chosen_frames_cover_the_motion_and_the_end() -> None:
    run = sliding_block(2)
    assert spread_frames(run, 6, 0.4) == [0, 1, 2, 3, 4, 11]
    assert len(spread_frames(run, 6, 1.1)) == 6
    assert spread_frames(run, 6, 1.1)[-1] == 11


def test_profile_and_curves(tmp_path: Path) -> None:
    x = np.linspace(0.0, 1.0, 41)
    draw_profile(tmp_path / "profile.png", x, (x < 0.3) * 0.2, 0.2 * (1.0 - x), (1.0, 0.25), "a heap")
    time = np.linspace(0.0, 1.0, 20)
    steps = {"time": time, "kinetic_energy": time * (1.0 - time), "potential_energy": 2.0 - time}
    observables = {
        **steps,
        "front": 0.3 + time,
        "front_bulk": 0.3 + 0.9 * time,
        "height": 0.2 - 0.1 * time,
    }
    draw_observables(tmp_path / "observables.png", steps, observables, 2, "a heap")
    for name in ("profile.png", "observables.png"):
        with Image.open(tmp_path / name) as picture:
            picture.verify()
            assert picture.width > 800
