"""Rest shapes of shells: drapes are equilibria, their derivative is exact, what is found hangs still (seed B 4.4.2)."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from barchan.bodies.cloth import ClothContacts, ClothMaterial, ShellEnergy, conical_skirt
from barchan.bodies.inverse.drape import Drape
from barchan.bodies.inverse.rest_shape import RestShapeOptions, rest_shape
from barchan.errors import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])
MATERIAL = ClothMaterial(young_modulus=1e5, thickness=1e-3, area_density=0.25, bending_stiffness=2e-4)
FRICTION = 0.4


def touching(vertices: np.ndarray, normals: np.ndarray, which: np.ndarray) -> ClothContacts:
    """Closed contacts of some vertices with a still obstacle."""
    k = len(which)
    corners, weights = np.full((k, 4), -1), np.zeros((k, 4))
    corners[:, 0], weights[:, 0] = which, 1.0
    zero = np.zeros((k, 3))
    return ClothContacts(
        -1 - which, np.zeros(k, int), corners, weights, vertices[which], normals[which], np.zeros(k), zero, np.full(k, FRICTION)
    )  # fmt: skip


def skirt() -> tuple[Drape, np.ndarray]:
    """A straight skirt whose upper third lies on hips of its own shape, and that shape."""
    mesh = conical_skirt(0.13, 0.15, 0.24, 0.06)
    x = mesh.vertices
    outward = np.column_stack(
        [x[:, :2] / np.linalg.norm(x[:, :2], axis=1)[:, None], np.full(len(x), 0.02 / 0.24)]
    )
    normals = outward / np.linalg.norm(outward, axis=1)[:, None]
    energy = ShellEnergy.of(mesh, MATERIAL)
    masses = MATERIAL.area_density * mesh.vertex_areas
    upper = np.flatnonzero(x[:, 2] > -0.08)
    return Drape(energy, masses, GRAVITY, x, touching(x, normals, upper)), x


DRAPE, TARGET = skirt()
PROXIMAL = 1e-2 / DRAPE.step


def test_a_drape_is_an_equilibrium_of_forces_within_the_cones() -> None:
    found = DRAPE.positions(TARGET, TARGET, PROXIMAL, 1e-10)
    assert found.converged and found.residual <= 1e-10
    gradient = DRAPE.gradient(DRAPE.energy, found.positions, PROXIMAL)
    pushed = DRAPE.rows.T @ found.forces.reshape(-1)
    np.testing.assert_allclose(gradient.reshape(-1), pushed, atol=1e-7 * DRAPE.size)
    normal, drag = found.forces[:, 0], np.linalg.norm(found.forces[:, 1:], axis=1)
    assert (drag <= FRICTION * normal + 1e-7 * DRAPE.size).all() and (normal > 0.0).any()
    away = np.einsum("kij,kj->ki", DRAPE.frames, (found.positions - TARGET)[DRAPE.vertices])
    assert (FRICTION * np.linalg.norm(away[:, 1:], axis=1) <= away[:, 0] + 1e-12).all()
    assert (found.positions - TARGET)[:, 2].min() < -1e-5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_derivative_of_the_drape_agrees_with_differences(seed: int) -> None:
    random = np.random.default_rng(seed)
    rest = TARGET + 1e-3 * random.standard_normal(TARGET.shape)
    change, moved = random.standard_normal((2, *TARGET.shape))
    found = DRAPE.positions(rest, TARGET, PROXIMAL, 1e-12)
    gradient = DRAPE.pulled_back(rest, found, change, PROXIMAL)
    h = 1e-6
    ends = [
        DRAPE.positions(rest + s * h * moved, found.positions, PROXIMAL, 1e-12).positions for s in (1.0, -1.0)
    ]
    expected = float(np.vdot(change, ends[0] - ends[1])) / (2.0 * h)
    assert float(np.vdot(gradient, moved)) == pytest.approx(expected, rel=1e-5)


def test_the_rest_shape_found_needs_no_more_than_friction_and_the_drawn_one_does() -> None:
    found = rest_shape(DRAPE, options=RestShapeOptions(imbalance=1e-3))
    assert DRAPE.imbalance(TARGET) == found.first_imbalance > 0.5
    assert found.imbalance <= 2e-3 and found.distance < 1e-6
    values = [value for stage, _, value in found.history if stage == 0]
    assert all(after <= before for before, after in itertools.pairwise(values))
    assert np.abs(found.rest - TARGET).max() < 0.02


def test_held_vertices_stay_and_a_free_cloth_needs_no_contacts() -> None:
    held = np.zeros(len(TARGET), bool)
    held[TARGET[:, 2] > -1e-9] = True
    none = touching(TARGET, np.zeros_like(TARGET), np.zeros(0, int))
    masses = -DRAPE.weight[:, 2] / 9.81
    drape = Drape(DRAPE.energy, masses, GRAVITY, TARGET, none, held)
    found = drape.positions(TARGET, TARGET, PROXIMAL)
    assert found.converged and np.array_equal(found.positions[held], TARGET[held])
    result = rest_shape(drape, options=RestShapeOptions(imbalance=1e-3, regularisation=1e-9))
    assert result.imbalance < 0.01 * result.first_imbalance


def test_bad_input_is_named() -> None:
    contacts = touching(TARGET, np.tile([0.0, 0.0, 1.0], (len(TARGET), 1)), np.arange(3))
    masses = np.ones(len(TARGET))
    doubled = replace(contacts, vertices=np.repeat(contacts.vertices[:1], 3, axis=0))
    several = replace(contacts, vertices=np.tile(np.arange(4), (3, 1)))
    for wrong in (doubled, several):
        with pytest.raises(InputError, match="contacts"):
            Drape(DRAPE.energy, masses, GRAVITY, TARGET, wrong)
    with pytest.raises(InputError, match="target"):
        Drape(DRAPE.energy, masses, GRAVITY, TARGET[:3], contacts)
    with pytest.raises(InputError, match="masses"):
        Drape(DRAPE.energy, masses[:3], GRAVITY, TARGET, contacts)
    with pytest.raises(InputError, match="guess"):
        rest_shape(DRAPE, TARGET[:3])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"proximal": ()}, "proximal"),
        ({"proximal": (1e-2, 1e-1)}, "proximal"),
        ({"iterations": 0}, "iterations"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"imbalance": -1.0}, "imbalance"),
        ({"regularisation": -1.0}, "regularisation"),
    ],
)
def test_unusable_options_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        RestShapeOptions(**options)  # type: ignore[arg-type]
