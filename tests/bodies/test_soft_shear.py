"""Plane shear at fixed pressure follows the published friction law of discs.

F. da Cruz, S. Emam, M. Prochnow, J.-N. Roux, F. Chevoir, Phys. Rev. E 72, 021309 (2005): discs of diameters 1 -+ 0.2, contact
friction 0.4, restitution 0.1: mu* = 0.25 + 1.1 I and volume fraction 0.81 - 0.3 I for I = gamma' sqrt(m / P) up to 0.2
(quoted from knowledge of the article, not read off a copy).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from barchan.bodies.coarse_graining import Lucy, coarse_grain, fit_mu_i
from barchan.bodies.soft import PlaneShear
from barchan.errors import InputError


def published(inertial: float) -> float:
    return 0.25 + 1.1 * inertial


def test_a_small_sheared_cell_is_within_a_fifth_of_the_published_friction() -> None:
    shear = PlaneShear(0.1 / math.sqrt(math.pi), count=150)
    state, average = shear.averaged(shear.settled(), strain=4.0, samples=80)
    assert average.disc_inertial_number == pytest.approx(0.1, rel=0.05)
    assert average.friction == pytest.approx(published(average.disc_inertial_number), rel=0.2)
    assert average.stress[1, 1] == pytest.approx(1.0, rel=0.1)
    np.testing.assert_allclose(average.stress, average.stress.T, atol=0.03)
    assert average.volume_fraction == pytest.approx(0.81 - 0.3 * 0.1, abs=0.015)
    assert 0.0 < average.friction_error < 0.05
    # the shear goes through all of the cell, with no jump at its sides
    grains, forces = shear.spheres.grains(state)
    height = state.cell.height
    heights = np.linspace(0.0, height, 30, endpoint=False)
    area = shear.volume(state) / height
    fields = coarse_grain(
        heights[:, None],
        grains,
        forces,
        Lucy(4.0),
        axes=(1,),
        area=area,
        periodic=shear.spheres.periodic(state),
    )
    assert np.mean(fields.velocity_gradient[:, 0, 1]) == pytest.approx(shear.shear_rate, rel=0.15)
    mean = shear.mean(state)
    np.testing.assert_allclose(np.mean(fields.contact_stress, axis=0), mean.contact_stress, atol=0.02)
    assert np.mean(fields.volume_fraction) == pytest.approx(mean.volume_fraction, rel=0.01)


@pytest.mark.slow
def test_friction_grows_with_the_inertial_number_as_published_and_fits_a_law() -> None:
    averages = []
    for inertial in (0.02, 0.05, 0.1, 0.2):
        shear = PlaneShear(inertial / math.sqrt(math.pi), count=500)
        averages.append(shear.averaged(shear.settled(), strain=5.0, samples=300)[1])
    friction = np.array([average.friction for average in averages])
    assert np.all(np.diff(friction) > 0.0)
    discs = np.array([average.disc_inertial_number for average in averages])
    np.testing.assert_allclose(friction, published(discs), rtol=0.2)
    np.testing.assert_allclose([a.volume_fraction for a in averages], 0.81 - 0.3 * discs, atol=0.015)
    numbers = np.array([average.inertial_number for average in averages])
    law = fit_mu_i(numbers, friction, [max(average.friction_error, 1e-3) for average in averages])
    assert 0.2 < law.mu_s < 0.3
    np.testing.assert_allclose(law.friction(numbers), friction, rtol=0.05)


def test_bad_input_is_named() -> None:
    for make, field in (
        (lambda: PlaneShear(0.0), "inertial_number"),
        (lambda: PlaneShear(0.1, dimension=4), "dimension"),
        (lambda: PlaneShear(0.1, count=10), "count"),
        (lambda: PlaneShear(0.1, spread=1.0), "spread"),
    ):
        with pytest.raises(InputError) as caught:
            make()
        assert caught.value.field == field
    shear = PlaneShear(0.1, count=60)
    with pytest.raises(InputError, match="samples"):
        shear.averaged(shear.start(), 1.0, 2)
