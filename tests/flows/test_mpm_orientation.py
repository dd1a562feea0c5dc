"""Orientation tensors stay orientation tensors and turn with the frame; their metric makes friction anisotropic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.cones import chi, chi_inverse, tensor_block_size
from barchan.errors import InputError
from barchan.flows.mpm.orientation import (
    aligned,
    decayed_cohesion,
    evolved_orientations,
    friction_metric,
    inverse_metric_blocks,
    isotropic,
    metric_blocks,
)

DIMENSIONS = [2, 3]


def random_orientations(d: int, count: int, rng: np.random.Generator) -> np.ndarray:
    normals = rng.normal(size=(count, d + 2, d))
    normals /= np.linalg.norm(normals, axis=2)[..., None]
    return np.einsum("pki,pkj->pij", normals, normals) / (d + 2)


def rotation(d: int, rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(d, d)))
    return q * np.sign(np.linalg.det(q)) if d == 3 else q


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(1e-3, 20.0), st.floats(0.0, 1.0))
@settings(max_examples=100, deadline=None)
def test_orientation_tensors_keep_trace_one_and_eigenvalues_between_zero_and_one(d, seed, dt, elongation):
    rng = np.random.default_rng(seed)
    before = np.concatenate(
        [random_orientations(d, 20, rng), aligned(rng.normal(size=d), 5), isotropic(5, d)]
    )
    follow = "normals" if seed % 2 else "tangents"
    after = evolved_orientations(before, rng.normal(size=(30, d, d)), dt, elongation, follow)
    np.testing.assert_allclose(np.trace(after, axis1=1, axis2=2), 1.0, atol=1e-13)
    values = np.linalg.eigvalsh(after)
    assert np.min(values) > -1e-13 and np.max(values) < 1.0 + 1e-13


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(0.0, 1.0))
@settings(max_examples=50, deadline=None)
def test_evolution_is_objective(d, seed, elongation):
    """Seen from a turned frame, the turned tensor evolves."""
    rng = np.random.default_rng(seed)
    q, nu, slope = rotation(d, rng), random_orientations(d, 10, rng), rng.normal(size=(10, d, d))
    turned = evolved_orientations(q @ nu @ q.T, q @ slope @ q.T, 0.3, elongation)
    np.testing.assert_allclose(turned, q @ evolved_orientations(nu, slope, 0.3, elongation) @ q.T, atol=1e-12)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("elongation", [0.0, 0.7])
def test_a_rigid_rotation_turns_the_tensor_with_the_matter(d, elongation):
    """The sign of the vorticity matters: (7.26) as printed, W pi + pi W, fails this."""
    nu = random_orientations(d, 8, np.random.default_rng(1))
    spin = np.zeros((8, d, d))
    spin[:, 0, 1], spin[:, 1, 0] = -2.0, 2.0  # u = 2 e_z x x
    turn = np.eye(d)
    turn[:2, :2] = [[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]
    np.testing.assert_allclose(
        evolved_orientations(nu, spin, 0.3, elongation), turn @ nu @ turn.T, atol=1e-14
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_the_evolution_solves_its_equation(d):
    """D pi/Dt = W pi - pi W + l (D pi + pi D - 2 (D:pi) pi), by a small step."""
    rng = np.random.default_rng(2)
    nu, slope, length, step = random_orientations(d, 20, rng), rng.normal(size=(20, d, d)), 0.6, 1e-6
    after = evolved_orientations(nu, slope, step, length)
    pi, rate = (np.eye(d) - nu) / (d - 1), -(after - nu) / (d - 1) / step
    strain, skew = 0.5 * (slope + np.swapaxes(slope, 1, 2)), 0.5 * (slope - np.swapaxes(slope, 1, 2))
    power = np.sum(strain * pi, axis=(1, 2))[:, None, None]
    expected = skew @ pi - pi @ skew + length * (strain @ pi + pi @ strain - 2 * power * pi)
    np.testing.assert_allclose(rate, expected, atol=2e-5)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("follow", ["tangents", "normals"])
def test_shear_lays_flat_grains_parallel_to_the_flow(d, follow):
    """Fig. 7.13: in u = (z, 0) plates turn their normals across the flow; followed as plates they become parallel."""
    slope = np.zeros((1, d, d))
    slope[0, 0, -1] = 1.0
    nu = isotropic(1, d)
    for _ in range(400):
        nu = evolved_orientations(nu, slope, 0.1, 1.0, follow)
    if d == 2 or follow == "normals":
        assert nu[0, -1, -1] > 0.99
    else:
        assert nu[0, -1, -1] > 1 / 3 + 0.1 and nu[0, 1, 1] > 1 / 3 and nu[0, 0, 0] < 0.2


def test_tangents_and_normals_are_one_in_the_plane():
    rng = np.random.default_rng(8)
    nu, slope = random_orientations(2, 30, rng), rng.normal(size=(30, 2, 2))
    ours, others = (evolved_orientations(nu, slope, 0.4, 0.8, follow) for follow in ("tangents", "normals"))
    np.testing.assert_allclose(ours, others, atol=1e-14)


def test_aligned_plates_turn_as_jeffery_says():
    """One normal stays one normal: n -> exp(dt (W - l D)) n, normalised."""
    rng = np.random.default_rng(9)
    normal, slope, length, step = rng.normal(size=3), rng.normal(size=(3, 3)), 0.8, 1e-6
    normal /= np.linalg.norm(normal)
    strain, skew = 0.5 * (slope + slope.T), 0.5 * (slope - slope.T)
    turned = normal + step * (
        skew @ normal - length * (strain @ normal - (normal @ strain @ normal) * normal)
    )
    after = evolved_orientations(aligned(normal, 1), slope[None], step, length, "normals")[0]
    np.testing.assert_allclose(after, np.outer(turned, turned), atol=1e-10)
    assert np.linalg.eigvalsh(after)[-1] == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_random_normals_give_isotropic_friction(d):
    metric = friction_metric(isotropic(4, d), [0.0, 0.3, 0.6, 0.99])
    np.testing.assert_allclose(metric, np.tile(np.eye(d), (4, 1, 1)), atol=1e-13)
    size = tensor_block_size(d)
    np.testing.assert_allclose(metric_blocks(metric), np.tile(np.eye(size), (4, 1, 1)), atol=1e-13)


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(0.0, 0.95))
@settings(max_examples=50, deadline=None)
def test_blocks_measure_deviators_with_the_metric_and_keep_the_pressure(d, seed, anisotropy):
    rng = np.random.default_rng(seed)
    metric = friction_metric(random_orientations(d, 6, rng), anisotropy)
    blocks, inverses = metric_blocks(metric), inverse_metric_blocks(metric)
    size = tensor_block_size(d)
    scale = np.max(np.abs(blocks)) * np.max(np.abs(inverses))
    np.testing.assert_allclose(blocks @ inverses, np.tile(np.eye(size), (6, 1, 1)), atol=1e-14 * size * scale)
    np.testing.assert_allclose(blocks, np.swapaxes(blocks, 1, 2), atol=0.0)
    assert np.min(np.linalg.eigvalsh(blocks)) > 0.0
    x = rng.normal(size=(6, size))
    mapped = np.einsum("qij,qj->qi", blocks, x)
    np.testing.assert_allclose(mapped[:, 0], x[:, 0], rtol=1e-14)
    x[:, 0] = 0.0
    deviator = metric @ chi(x) @ metric
    exact = np.sqrt(0.5 * np.sum(deviator**2, axis=(1, 2)))
    np.testing.assert_allclose(np.linalg.norm(mapped[:, 1:], axis=1), exact, rtol=1e-11)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("anisotropy", [0.2, 0.7])
def test_effective_friction_of_aligned_grains(d, anisotropy):
    """|tau| / |tau|_A: (1 - a)^2 for shears in the plane of the grains, (1 - a)(1 + (d - 1) a) for shears across it.

    Seed B's (1 + (d - 1) a)^2 "in the normal direction" is the factor of the tensor n n^T alone, which is no deviator.
    """
    metric = friction_metric(aligned(np.eye(d)[-1], 1), anisotropy)
    along, across = 1.0 - anisotropy, 1.0 + (d - 1) * anisotropy
    np.testing.assert_allclose(np.diag(metric[0]), [1 / along] * (d - 1) + [1 / across], rtol=1e-14)
    blocks = metric_blocks(metric)[0]

    def factor(tensor: np.ndarray) -> float:
        x = chi_inverse(tensor)
        return float(np.linalg.norm(x) / np.linalg.norm(blocks @ x))

    shear = np.zeros((d, d))
    shear[0, -1] = shear[-1, 0] = 1.0
    assert factor(shear) == pytest.approx(along * across, rel=1e-13)
    if d == 3:
        shear = np.zeros((3, 3))
        shear[0, 1] = shear[1, 0] = 1.0
        assert factor(shear) == pytest.approx(along**2, rel=1e-13)
        assert factor(np.diag([1.0, -1.0, 0.0])) == pytest.approx(along**2, rel=1e-13)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_the_change_of_variables_keeps_the_power_and_the_flow_rule(d):
    """lambda~ = G lambda, gamma~ = G^-1 gamma: saturated friction along the maximal dissipation in both languages."""
    rng = np.random.default_rng(5)
    metric = friction_metric(random_orientations(d, 1, rng), 0.5)
    g, h = metric_blocks(metric)[0], inverse_metric_blocks(metric)[0]
    friction, pressure = 0.4, 2.0
    strain = np.append(0.0, rng.normal(size=len(g) - 1))  # gamma, isochoric
    direction = (h @ strain)[1:]
    force = h @ np.append(pressure, friction * pressure * direction / np.linalg.norm(direction))
    assert np.linalg.norm((g @ force)[1:]) == pytest.approx(friction * pressure)
    best = force[1:] @ strain[1:]
    for _ in range(300):
        other = rng.normal(size=len(g) - 1)
        other *= friction * pressure / np.linalg.norm((g @ np.append(0.0, other))[1:])
        assert other @ strain[1:] <= best * (1 + 1e-12)
    assert (g @ force) @ (h @ strain) == pytest.approx(force @ strain)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_cohesion_decays_exponentially_with_strain_and_not_with_rotation(d):
    shear = np.zeros((3, d, d))
    shear[0, 0, 1] = 2.0  # |D|^2 = D:D/2 = (1 + 1) / 2
    shear[1, 0, 1], shear[1, 1, 0] = 5.0, -5.0
    after = decayed_cohesion([10.0, 10.0, 10.0], shear, 3.0, 0.1)
    np.testing.assert_allclose(after, [10.0 * np.exp(-0.3), 10.0, 10.0], rtol=1e-14)
    halves = decayed_cohesion(decayed_cohesion([10.0] * 3, shear, 3.0, 0.05), shear, [3.0, 3.0, 3.0], 0.05)
    np.testing.assert_allclose(halves, after, rtol=1e-14)


def test_bad_input_is_refused():
    nu = isotropic(2, 3)
    with pytest.raises(InputError, match="elongation"):
        evolved_orientations(nu, np.zeros((2, 3, 3)), 0.1, 1.5)
    with pytest.raises(InputError, match="gradients"):
        evolved_orientations(nu, np.zeros((2, 2, 2)), 0.1, 0.5)
    with pytest.raises(InputError, match="follow"):
        evolved_orientations(nu, np.zeros((2, 3, 3)), 0.1, 0.5, "fibres")
    for bad in (1.0, -0.1, [0.1, 0.2, 0.3], float("nan")):
        with pytest.raises(InputError, match="anisotropy"):
            friction_metric(nu, bad)
    with pytest.raises(InputError, match="normal"):
        aligned([0.0, 0.0], 3)
    with pytest.raises(InputError, match="decay_rate"):
        decayed_cohesion([1.0], np.zeros((1, 3, 3)), -1.0, 0.1)
    with pytest.raises(InputError, match="cohesions"):
        decayed_cohesion([1.0], np.zeros((2, 3, 3)), 1.0, 0.1)
