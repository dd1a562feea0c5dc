"""The map chi is an isometry (seed B, 6.3.1) and friction angles mean what Mohr and Coulomb meant (0.3.2)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from barchan.cones import (
    angle_from_friction,
    chi,
    chi_inverse,
    friction_from_angle,
    normalised_friction,
    physical_friction,
    tensor_block_size,
)
from barchan.errors import InputError

VARIANTS = ("circumscribed", "interpolated", "inscribed")
angles = st.floats(0.0, np.pi / 2)
# Multiples of 1/1000: LAPACK loses digits on tensors with components near 1e-145, which no stress has.
components = st.integers(-10_000, 10_000).map(lambda thousandths: thousandths / 1000.0)


@st.composite
def cone_vectors(draw, count: int):
    size = draw(st.sampled_from([3, 6]))
    return draw(arrays(np.float64, (count, size), elements=components))


@given(cone_vectors(2))
def test_chi_is_an_orthonormal_isomorphism(xs) -> None:
    """x . y = chi(x):chi(y)/2 and chi_inverse undoes chi."""
    tensors = chi(xs)
    assert np.sum(tensors[0] * tensors[1]) / 2 == pytest.approx(xs[0] @ xs[1], abs=1e-10)
    np.testing.assert_allclose(chi_inverse(tensors), xs, atol=1e-13)
    np.testing.assert_array_equal(tensors, np.swapaxes(tensors, -1, -2))


@given(cone_vectors(1))
def test_normal_part_is_the_trace_and_tangential_part_the_deviator(xs) -> None:
    x, tensor = xs[0], chi(xs[0])
    d = len(tensor)
    deviator = tensor - np.trace(tensor) / d * np.eye(d)
    assert np.trace(tensor) / np.sqrt(2 * d) == pytest.approx(x[0], abs=1e-11)
    assert np.sqrt(np.sum(deviator**2) / 2) == pytest.approx(np.linalg.norm(x[1:]), abs=1e-11)


@given(st.sampled_from([2, 3]).flatmap(lambda d: arrays(np.float64, (d, d), elements=components)))
def test_chi_inverse_is_the_adjoint_and_sees_the_symmetric_part_only(tensor) -> None:
    x = np.linspace(-1.0, 2.0, tensor_block_size(len(tensor)))
    assert x @ chi_inverse(tensor) == pytest.approx(np.sum(chi(x) * tensor) / 2, abs=1e-11)
    np.testing.assert_allclose(chi(chi_inverse(tensor)), (tensor + tensor.T) / 2, atol=1e-13)


def test_chi_is_the_published_basis() -> None:
    """Definition 6.1, component by component."""
    a, b, c, d, e, f = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
    np.testing.assert_allclose(chi([a, b, c]), [[a + b, c], [c, a - b]])
    root3 = np.sqrt(3.0)
    deviator = [[b - c / root3, d, e], [d, -b - c / root3, f], [e, f, 2 * c / root3]]
    np.testing.assert_allclose(chi([a, b, c, d, e, f]), np.sqrt(2 / 3) * a * np.eye(3) + deviator)
    assert (tensor_block_size(2), tensor_block_size(3)) == (3, 6)


@given(cone_vectors(1), st.floats(0.0, 2.0))
def test_normalised_friction_bounds_the_deviator_by_the_mean_pressure(xs, mu_hat) -> None:
    """|T| - mu N = sqrt(J2) - mu_hat p, with p the mean of the (compressive) principal stresses."""
    principal = np.linalg.eigvalsh(chi(xs[0]))
    d = len(principal)
    root_j2 = np.sqrt(np.sum((principal - principal.mean()) ** 2) / 2)
    mu = normalised_friction(mu_hat, d)
    assert np.linalg.norm(xs[0, 1:]) - mu * xs[0, 0] == pytest.approx(
        root_j2 - mu_hat * principal.mean(), abs=1e-10
    )
    assert physical_friction(mu, d) == pytest.approx(mu_hat, rel=1e-14)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("d", [2, 3])
@given(phi=angles)
def test_angle_and_friction_are_inverse_functions(d, variant, phi) -> None:
    """To the digits the flat top of the sine near pi/2 leaves."""
    mu_hat = friction_from_angle(phi, d, variant)
    assert angle_from_friction(mu_hat, d, variant) == pytest.approx(phi, abs=1e-7)
    assert np.sin(angle_from_friction(mu_hat, d, variant)) == pytest.approx(np.sin(phi), abs=1e-14)


def mohr_coulomb_excess(tensor, phi) -> float:
    """(s1 - s3)/2 - sin(phi) (s1 + s3)/2 of the extreme stresses, compression positive: stable when <= 0."""
    principal = np.linalg.eigvalsh(tensor)
    return (principal[-1] - principal[0]) / 2 - np.sin(phi) * (principal[-1] + principal[0]) / 2


@given(arrays(np.float64, 3, elements=components), angles)
def test_in_2d_drucker_prager_is_mohr_coulomb(x, phi) -> None:
    mu = normalised_friction(friction_from_angle(phi, 2), 2)
    assert np.linalg.norm(x[1:]) - mu * x[0] == pytest.approx(mohr_coulomb_excess(chi(x), phi), abs=1e-11)


@given(arrays(np.float64, 5, elements=components).filter(np.any), angles)
def test_in_3d_the_cones_bracket_mohr_coulomb(tangential, phi) -> None:
    """The inscribed cone is in the Mohr-Coulomb pyramid, the pyramid in the circumscribed cone."""
    length = np.linalg.norm(tangential)
    on_circle = np.concatenate([[1.0], tangential / length]) if length else np.eye(6)[0]
    inscribed, circumscribed = (
        on_circle * [1.0, *[normalised_friction(friction_from_angle(phi, 3, variant), 3)] * 5]
        for variant in ("inscribed", "circumscribed")
    )
    assert mohr_coulomb_excess(chi(inscribed), phi) <= 1e-12
    assert not length or mohr_coulomb_excess(chi(circumscribed), phi) >= -1e-12


def hexagon_radius(lode, phi):
    """sqrt(J2)/p where the Mohr-Coulomb hexagon meets the direction `lode` of the deviatoric plane."""
    principal = 2 / np.sqrt(3) * np.cos(lode[..., None] + np.array([0.0, 2.0, 4.0]) * np.pi / 3)
    half_sum = (principal.max(axis=-1) + principal.min(axis=-1)) / 2
    half_difference = (principal.max(axis=-1) - principal.min(axis=-1)) / 2
    return np.sin(phi) / (half_difference - np.sin(phi) * half_sum)


@pytest.mark.parametrize("degrees", [5.0, 30.0, 45.0, 70.0])
def test_the_three_circles_of_the_mohr_coulomb_hexagon(degrees) -> None:
    """Through its outer vertices, through its inner vertices, tangent to its sides."""
    phi = np.radians(degrees)
    lode = np.linspace(0.0, 2 * np.pi, 360_001)
    radius = hexagon_radius(lode, phi)
    assert friction_from_angle(phi, 3, "circumscribed") == pytest.approx(radius.max(), rel=1e-9)
    assert friction_from_angle(phi, 3, "inscribed") == pytest.approx(radius.min(), rel=1e-9)
    inner_vertices = hexagon_radius(np.array([1.0, 3.0, 5.0]) * np.pi / 3, phi)
    np.testing.assert_allclose(friction_from_angle(phi, 3, "interpolated"), inner_vertices, rtol=1e-13)
    # At the two kinds of vertices the hexagon has a corner: the radius falls on both sides.
    for corner in (0.0, np.pi / 3):
        beside = hexagon_radius(np.array([corner - 1e-4, corner, corner + 1e-4]), phi)
        assert beside[1] > beside[0]
        assert beside[1] > beside[2]


def test_arrays_of_angles_give_arrays() -> None:
    phi = np.radians([0.0, 20.0, 40.0])
    mu_hat = friction_from_angle(phi, 3, "interpolated")
    assert mu_hat.shape == (3,)
    np.testing.assert_allclose(angle_from_friction(mu_hat, 3, "interpolated"), phi, atol=1e-14)
    assert isinstance(friction_from_angle(0.5, 2), float)
    assert normalised_friction(mu_hat, 2).tolist() == mu_hat.tolist()


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: friction_from_angle(-0.1, 3), "phi_radians"),
        (lambda: friction_from_angle(np.nan, 3), "phi_radians"),
        (lambda: friction_from_angle(30.0, 2), "phi_radians"),
        (lambda: friction_from_angle(0.5, 4), "d"),
        (lambda: friction_from_angle(0.5, 3, "middle"), "variant"),
        (lambda: angle_from_friction(-0.1, 3), "mu_hat"),
        (lambda: angle_from_friction(1.01, 2), "mu_hat"),
        (lambda: angle_from_friction(0.9, 3, "inscribed"), "mu_hat"),
        (lambda: normalised_friction(-1.0, 3), "mu_hat"),
        (lambda: physical_friction(np.nan, 2), "mu"),
        (lambda: tensor_block_size(1), "d"),
        (lambda: chi(np.ones(4)), "x"),
        (lambda: chi(1.0), "x"),
        (lambda: chi_inverse(np.ones((2, 3))), "t"),
        (lambda: chi_inverse(np.ones((4, 4))), "t"),
    ],
)
def test_bad_input_is_refused(call, field) -> None:
    with pytest.raises(InputError, match=f"^{field} = "):
        call()
