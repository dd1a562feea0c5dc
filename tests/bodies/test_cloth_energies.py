"""Energies of cloth: derivatives, invariance, rigidity of a bent cylinder, positive semidefinite parts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from barchan.bodies.cloth import ClothMaterial, ShellEnergy, conical_skirt, rectangle
from barchan.errors import InputError

STEP = 1e-6


def shaken(membrane: Any, seed: int = 0) -> tuple[ShellEnergy, Any, Any]:
    """A coarse skirt with strained positions q and changed rest positions p, flattened."""
    mesh = conical_skirt(0.5, 1.0, 1.0, 0.5) if seed % 2 else rectangle(1.0, 1.0, 0.34, "unstructured")
    material = ClothMaterial(young_modulus=1e3, bending_stiffness=0.3, membrane=membrane)
    rng = np.random.default_rng(seed)
    q, p = (mesh.vertices + 0.1 * rng.normal(size=mesh.vertices.shape) for _ in range(2))
    return ShellEnergy.of(mesh, material).with_rest(p), q.ravel(), p.ravel()


def differences(function: Any, at: Any) -> Any:
    """Central differences of a function of a flat array, along the last axis."""
    ways = STEP * np.eye(len(at))
    return np.stack([(function(at + way) - function(at - way)) / (2.0 * STEP) for way in ways], axis=-1)


@pytest.mark.parametrize("membrane", ["stvk", "springs"])
@pytest.mark.parametrize("seed", [0, 1])
def test_derivatives_are_those_of_the_energy(membrane: str, seed: int) -> None:
    energy, q, p = shaken(membrane, seed)
    gradient = energy.gradient(q).ravel()
    hessian, mixed = energy.hessian(q).toarray(), energy.mixed_derivative(q).toarray()
    for exact, found in (
        (differences(energy.value, q), gradient),
        (differences(lambda x: energy.gradient(x).ravel(), q), hessian),
        (differences(lambda x: energy.with_rest(x).gradient(q).ravel(), p), mixed),
    ):
        assert np.max(np.abs(found - exact)) < 1e-6 * np.max(np.abs(exact))
    assert np.max(np.abs(hessian - hessian.T)) < 1e-12 * np.max(np.abs(hessian))


@pytest.mark.parametrize("membrane", ["stvk", "springs"])
def test_the_convex_part_is_semidefinite_and_dominates_the_hessian_of_the_membrane(membrane: str) -> None:
    energy, q, _ = shaken(membrane)
    convex, exact = energy.hessian(q, convex=True).toarray(), energy.hessian(q).toarray()
    scale = np.max(np.abs(exact))
    assert np.linalg.eigvalsh(convex)[0] > -1e-12 * scale
    assert np.linalg.eigvalsh(exact)[0] < -1e-3 * scale  # of this crumpled shape
    soft = ClothMaterial(young_modulus=1e3, bending_stiffness=0.0, membrane=membrane)  # type: ignore[arg-type]
    sheet = ShellEnergy.of(energy.mesh, soft).with_rest(energy.rest)
    gap = sheet.hessian(q, convex=True).toarray() - sheet.hessian(q).toarray()
    assert np.linalg.eigvalsh(gap)[0] > -1e-12 * scale


@pytest.mark.parametrize("membrane", ["stvk", "springs"])
def test_the_convex_part_is_the_whole_hessian_at_rest(membrane: str) -> None:
    energy, _, p = shaken(membrane, 1)
    exact = energy.hessian(p).toarray()
    assert np.max(np.abs(energy.hessian(p, convex=True).toarray() - exact)) < 1e-9 * np.max(np.abs(exact))
    assert energy.value(p) == pytest.approx(0.0, abs=1e-20)
    mixed = energy.mixed_derivative(p).toarray()
    # rest and place matter by their difference only, where they agree
    assert np.max(np.abs(mixed + exact)) < 1e-9 * np.max(np.abs(exact))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 999), st.floats(-3.0, 3.0), st.sampled_from(["stvk", "springs"]))
def test_energy_does_not_see_rigid_motions_nor_its_forces_push_or_turn(
    seed: int, angle: float, membrane: str
) -> None:
    energy, q, p = shaken(membrane, seed % 2)
    x = q.reshape(-1, 3)
    turn = Rotation.from_rotvec(angle * np.array([0.36, -0.48, 0.8])).as_matrix()
    moved = x @ turn.T + (0.1, -3.0, 2.0)
    value, forces = energy.value(x), energy.gradient(x)
    assert energy.value(moved) == pytest.approx(value, rel=1e-9)
    np.testing.assert_allclose(energy.gradient(moved), forces @ turn.T, atol=1e-8 * np.max(np.abs(forces)))
    assert np.max(np.abs(forces.sum(axis=0))) < 1e-10 * np.max(np.abs(forces))
    assert np.max(np.abs(np.cross(x, forces).sum(axis=0))) < 1e-10 * np.max(np.abs(forces))
    turned_rest = energy.with_rest((p.reshape(-1, 3) @ turn.T).ravel())
    assert turned_rest.value(x) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(
    ("pattern", "accuracy"), [("squares", 2e-3), ("equilateral", 1.5e-2), ("unstructured", 0.2)]
)
def test_bending_to_a_cylinder_costs_half_d_kappa_squared(pattern: Any, accuracy: float) -> None:
    mesh = rectangle(2.0, 2.0, 0.04, pattern)
    energy = ShellEnergy.of(mesh, ClothMaterial(young_modulus=1e-9, bending_stiffness=0.7))
    radius = 3.0
    angle = mesh.vertices[:, 0] / radius
    bent = np.stack([radius * np.sin(angle), mesh.vertices[:, 1], radius * (1.0 - np.cos(angle))], axis=1)
    # a hinge stands for the triangles on both of its sides: at a boundary half a triangle counts for none
    inner = 4.0 * (1.0 - 0.02)
    assert energy.value(bent) == pytest.approx(0.5 * 0.7 / radius**2 * inner, rel=accuracy)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_a_stretched_sheet_stores_the_energy_of_plane_stress(nu: float) -> None:
    mesh = rectangle(1.0, 0.5, 0.1, "unstructured")
    material = ClothMaterial(young_modulus=1e4, poisson_ratio=nu, thickness=1e-3)
    energy = ShellEnergy.of(mesh, material)
    along, across = 1.02, 0.99
    e1, e2 = 0.5 * (along**2 - 1.0), 0.5 * (across**2 - 1.0)
    exact = 0.5 * 0.5 * 10.0 / (1.0 - nu**2) * (e1**2 + e2**2 + 2.0 * nu * e1 * e2)
    assert energy.value(mesh.vertices * (along, across, 1.0)) == pytest.approx(exact, rel=1e-10)


def test_springs_of_equilateral_triangles_stretch_like_a_sheet_of_poissons_ratio_one_third() -> None:
    mesh = rectangle(1.0, math.sqrt(0.75), 0.025)
    energy = ShellEnergy.of(mesh, ClothMaterial(young_modulus=1e4, thickness=1e-3, membrane="springs"))
    strain = 1e-3
    value = energy.value(mesh.vertices * (1.0 + strain, 1.0 + strain, 1.0))
    exact = math.sqrt(0.75) * 10.0 / (1.0 - 1.0 / 3.0) * strain**2
    assert value == pytest.approx(exact, rel=1e-3)


def test_bad_materials_and_positions_are_refused() -> None:
    for name, value in (
        ("young_modulus", 0.0), ("poisson_ratio", 0.6), ("thickness", -1.0), ("area_density", math.nan),
        ("membrane", "rubber"), ("bending_stiffness", -1.0), ("mass_damping", -1.0), ("friction", -0.1),
    ):  # fmt: skip
        with pytest.raises(InputError, match=name):
            ClothMaterial(**{name: value})  # type: ignore[arg-type]
    energy, q, _ = shaken("stvk")
    with pytest.raises(InputError, match="q"):
        energy.value(q[:-3])
    with pytest.raises(InputError, match="rest"):
        energy.with_rest(q * np.nan)
