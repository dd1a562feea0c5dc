"""Passive grains fill their particles' ellipsoids evenly and never leave them."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.mpm.frames import ELLIPSOID_RADII, advected_frames, initial_frames
from barchan.flows.mpm.grains import Grains, confined_grains, moved_grains, renamed_grains, sample_grains
from barchan.flows.mpm.resampling import Resampling, resample

DIMENSIONS = [2, 3]


def particles(d: int, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    frames = initial_frames(rng.uniform(0.05, 0.3, (count, d)))
    return rng.uniform(size=(count, d)), advected_frames(frames, rng.normal(size=(count, d, d)), 0.5)


def depths(grains: Grains, positions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Radius of each grain in the ball its owner's ellipsoid is the image of; at most one inside."""
    arms = grains.positions - positions[grains.owners]
    inverse = np.linalg.inv(frames)[grains.owners]
    return np.sqrt(np.einsum("gi,gij,gj->g", arms, inverse, arms)) / ELLIPSOID_RADII[frames.shape[1]]


@pytest.mark.parametrize("d", DIMENSIONS)
def test_grains_fill_the_ellipsoids_evenly(d):
    positions, frames = particles(d, 20, 0)
    grains = sample_grains(positions, frames, 2000, seed=3)
    radii = depths(grains, positions, frames)
    assert np.max(radii) <= 1.0 + 1e-12
    # In a ball filled evenly r^d is uniform; 40,000 samples: quantiles known to about 0.005.
    np.testing.assert_allclose(np.quantile(radii**d, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.012)
    means = np.stack([np.mean(grains.positions[grains.owners == p], axis=0) for p in range(20)])
    np.testing.assert_allclose(means, positions, atol=0.05)


def test_the_same_seed_gives_the_same_grains_and_counts_may_differ():
    positions, frames = particles(3, 5, 1)
    first, second = (sample_grains(positions, frames, [0, 1, 2, 3, 4], seed=8) for _ in range(2))
    assert np.array_equal(first.positions, second.positions)
    assert np.bincount(first.owners, minlength=5).tolist() == [0, 1, 2, 3, 4]
    assert not np.array_equal(
        first.positions, sample_grains(positions, frames, [0, 1, 2, 3, 4], seed=9).positions
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_grains_and_frames_move_as_one(d):
    """The depth of a grain in its ellipsoid is constant: it cannot escape an advected frame."""
    rng = np.random.default_rng(2)
    positions, frames = particles(d, 30, 2)
    grains = sample_grains(positions, frames, 10, seed=0)
    before = depths(grains, positions, frames)
    for _ in range(5):
        gradients, moved = rng.normal(size=frames.shape), positions + 0.1 * rng.normal(size=positions.shape)
        after = advected_frames(frames, gradients, 0.1)
        grains = moved_grains(grains, positions, gradients, moved, after, 0.1)
        positions, frames = moved, after
    np.testing.assert_allclose(depths(grains, positions, frames), before, rtol=1e-9)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_in_an_affine_flow_every_grain_follows_the_flow(d):
    rng = np.random.default_rng(4)
    positions, frames = particles(d, 10, 4)
    gradient, velocity, dt = rng.normal(size=(d, d)), rng.normal(size=d), 1e-4
    gradients = np.tile(gradient, (10, 1, 1))
    grains = sample_grains(positions, frames, 5, seed=0)
    moved = moved_grains(
        grains, positions, gradients, positions + dt * (velocity + positions @ gradient.T),
        advected_frames(frames, gradients, dt), dt,
    )  # fmt: skip
    expected = grains.positions + dt * (velocity + grains.positions @ gradient.T)
    np.testing.assert_allclose(moved.positions, expected, atol=100 * dt**2 * 0.3)


def test_escaped_grains_come_back_to_the_surface_and_into_the_box():
    positions, frames = np.array([[0.5, 0.5]]), initial_frames([[0.4, 0.2]])
    grains = Grains(np.array([[1.5, 0.5], [0.5, 0.55], [0.5, -3.0]]), np.zeros(3, dtype=np.int64))
    back = confined_grains(grains, positions, frames, lower=[0.0, 0.45], upper=[1.0, 1.0])
    radius = ELLIPSOID_RADII[2]
    np.testing.assert_allclose(
        back.positions, [[0.5 + 0.2 * radius, 0.5], [0.5, 0.55], [0.5, 0.45]], rtol=1e-14
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_grains_go_to_the_heirs_of_their_owners(d):
    rng = np.random.default_rng(6)
    positions, frames = particles(d, 200, 6)
    fields = {
        "positions": positions,
        "velocities": np.zeros((200, d)),
        "affine": np.zeros((200, d, d)),
        "volumes": rng.uniform(size=200) + 1.0,
        "frames": frames,
    }
    cells = (np.arange(200) < 150).astype(np.int64)  # one cell crowded: merges; one not: splits
    after = resample(fields, cells, Resampling(most_per_cell=100), np.ones(d))
    split = np.flatnonzero(np.bincount(after.parents, minlength=200) == 2)
    assert len(split) and len(after.parents) < 200 + len(split)  # some split, some merged
    grains = sample_grains(positions, frames, 20, seed=1)
    renamed = renamed_grains(
        grains, after.parents, after.heirs, after.fields["positions"], after.fields["frames"]
    )
    assert np.array_equal(renamed.positions, grains.positions)
    once = ~np.isin(grains.owners, split)
    assert np.array_equal(renamed.owners[once], after.heirs[grains.owners[once]])
    chosen, other = renamed.owners[~once], 2 * after.heirs[grains.owners[~once]] + 1 - renamed.owners[~once]
    assert np.array_equal(after.parents[chosen], grains.owners[~once])
    assert 0.4 < np.mean(chosen > other) < 0.6
    nearest = [
        np.sum((grains.positions[~once] - after.fields["positions"][side]) ** 2, axis=1)
        for side in (chosen, other)
    ]
    # nearer in the child's own metric is nearer along the halved axis, which is mostly nearer outright
    assert np.mean(nearest[0] < nearest[1]) > 0.95


def test_bad_grains_are_refused():
    positions, frames = particles(2, 3, 0)
    for bad in (-1, 1.5, [1, 2]):
        with pytest.raises(InputError, match="count"):
            sample_grains(positions, frames, bad, seed=0)
    with pytest.raises(InputError, match="seed"):
        sample_grains(positions, frames, 1, seed=-1)
    with pytest.raises(InputError, match="positive definite"):
        sample_grains(positions, -frames, 1, seed=0)
    with pytest.raises(InputError, match="owners"):
        confined_grains(Grains(np.zeros((1, 2)), np.array([3])), positions, frames)
    with pytest.raises(InputError, match="owners"):
        Grains(np.zeros((2, 2)), np.array([0]))
