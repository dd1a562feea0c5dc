"""Particle frames follow the flow exactly: volumes, ellipsoids and their axes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from barchan.errors import InputError
from barchan.flows.mpm.frames import (
    advected_frames,
    bounded_frames,
    flow_maps,
    frame_volumes,
    initial_frames,
    semi_axes,
)

DIMENSIONS = [2, 3]


def random_frames(d: int, count: int, rng: np.random.Generator) -> np.ndarray:
    roots = rng.normal(size=(count, d, d))
    return roots @ np.swapaxes(roots, 1, 2) + 0.05 * np.eye(d)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_frame_has_the_volume_of_its_brick(d):
    widths = np.random.default_rng(0).uniform(0.1, 2.0, (50, d))
    np.testing.assert_allclose(frame_volumes(initial_frames(widths)), np.prod(widths, axis=1), rtol=1e-14)


def long_exponential(matrix: np.ndarray) -> np.ndarray:
    """Taylor series of exp(A / 2^12) - 1, squared 12 times, in extended precision (expm loses digits for large 2 x 2)."""
    small, one = matrix.astype(np.longdouble) / 2**12, np.eye(len(matrix), dtype=np.longdouble)
    change, term = np.zeros_like(one), one
    for k in range(1, 25):
        term = term @ small / k
        change = change + term
    for _ in range(12):
        change = 2 * change + change @ change
    return (change + one).astype(np.float64)


@given(st.sampled_from(DIMENSIONS), st.floats(1e-8, 30.0), st.integers(0, 10_000))
@settings(max_examples=150, deadline=None)
def test_flow_maps_are_matrix_exponentials(d, size, seed):
    gradients = np.random.default_rng(seed).normal(size=(3, d, d))
    gradients *= size / np.linalg.norm(gradients, axis=(1, 2))[:, None, None]
    for ours, gradient in zip(flow_maps(gradients, 0.7), gradients, strict=True):
        exact = long_exponential(0.7 * gradient)
        assert np.linalg.norm(ours - exact) < 1e-13 * max(1.0, size) * np.linalg.norm(exact)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_relative_error_of_the_exponential_at_the_size_of_a_step(d):
    gradients = np.random.default_rng(1).uniform(-1.0, 1.0, (300, d, d))
    for ours, gradient in zip(flow_maps(gradients, 1.0), gradients, strict=True):
        exact = expm(gradient)
        assert np.linalg.norm(ours - exact) < 1e-13 * np.linalg.norm(exact)


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(1e-3, 0.5))
@settings(max_examples=60, deadline=None)
def test_frames_stay_symmetric_and_positive_and_volumes_follow_the_divergence(d, seed, dt):
    rng = np.random.default_rng(seed)
    frames, gradients = random_frames(d, 20, rng), rng.normal(size=(20, d, d))
    after = advected_frames(frames, gradients, dt)
    assert np.array_equal(after, np.swapaxes(after, 1, 2))
    assert np.min(np.linalg.eigvalsh(after)) > 0.0
    growth = np.exp(dt * np.trace(gradients, axis1=1, axis2=2))
    np.testing.assert_allclose(frame_volumes(after), growth * frame_volumes(frames), rtol=1e-8)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_frames_solve_their_evolution_equation(d):
    """(7.20), by a central difference in time."""
    rng = np.random.default_rng(3)
    frames, gradients = random_frames(d, 10, rng), rng.normal(size=(10, d, d))
    step = 1e-4
    rate = (advected_frames(frames, gradients, step) - advected_frames(frames, gradients, -step)) / (2 * step)
    strain, skew = (
        0.5 * (gradients + np.swapaxes(gradients, 1, 2)),
        0.5 * (gradients - np.swapaxes(gradients, 1, 2)),
    )
    np.testing.assert_allclose(rate, (strain + skew) @ frames + frames @ (strain - skew), atol=1e-6)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_rigid_rotation_turns_the_axes_and_keeps_the_lengths(d):
    spin = np.zeros((1, d, d))
    spin[0, 0, 1], spin[0, 1, 0] = -1.0, 1.0
    frame = initial_frames([[4.0, 2.0, 1.0][:d]])
    lengths, axes = semi_axes(advected_frames(frame, spin, np.pi / 3))
    np.testing.assert_allclose(lengths[0], [2.0, 1.0, 0.5][:d], rtol=1e-14)
    assert abs(axes[0, 0] @ [0.5, np.sqrt(0.75), 0.0][:d]) == pytest.approx(1.0, abs=1e-14)


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(-6.0, 0.0))
@settings(max_examples=80, deadline=None)
def test_semi_axes_rebuild_the_frame(d, seed, thinness):
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(d, d)))
    lengths = 10.0 ** rng.uniform(thinness, 0.0, d)
    if seed % 5 == 0:
        lengths[:2] = lengths[0]  # a double eigenvalue
    frame = (basis * lengths**2) @ basis.T
    found, axes = semi_axes(frame[None])
    assert np.all(np.diff(found[0]) <= 0.0)
    np.testing.assert_allclose(axes[0] @ axes[0].T, np.eye(d), atol=1e-14)
    np.testing.assert_allclose((axes[0].T * found[0] ** 2) @ axes[0], frame, atol=1e-14)


def test_bounded_frames_keep_directions_and_clip_lengths():
    frames = random_frames(3, 40, np.random.default_rng(5))
    lengths, axes = semi_axes(frames)
    bounded, kept = semi_axes(bounded_frames(frames, 0.5, 1.5))
    np.testing.assert_allclose(bounded, np.clip(lengths, 0.5, 1.5), rtol=1e-12)
    inside = (lengths[:, 0] > 0.5) & (lengths[:, 0] < 1.5) & (lengths[:, 1] < 0.99 * lengths[:, 0])
    np.testing.assert_allclose(np.abs(np.sum(axes[inside, 0] * kept[inside, 0], axis=1)), 1.0, rtol=1e-12)


@pytest.mark.parametrize("bad", [[[1.0, 0.0]], [[1.0, np.nan]], [1.0, 2.0], [[1.0]]])
def test_bad_widths_are_refused(bad):
    with pytest.raises(InputError, match="widths"):
        initial_frames(bad)


def test_bad_gradients_are_refused():
    frames = initial_frames(np.ones((4, 2)))
    with pytest.raises(InputError, match="gradients"):
        advected_frames(frames, np.zeros((4, 3, 3)), 0.1)
    with pytest.raises(InputError, match="gradients"):
        advected_frames(frames, np.full((4, 2, 2), np.inf), 0.1)
    with pytest.raises(InputError, match="shortest"):
        bounded_frames(frames, 2.0, 1.0)
