"""Boundary conditions of dense flows: which velocities are prescribed, which combinations are refused (seed A, 4.1-4.4)."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

from barchan.errors import InputError
from barchan.flows.dense import (
    DenseFlow,
    FreeSlip,
    FrictionalWall,
    Material,
    NoSlip,
    Pressure,
    Stress,
    Symmetry,
    Velocity,
)
from barchan.flows.dense.reduction import free_rigid_motions, reduce
from barchan.spaces.meshes import box, channel_with_cylinder, rectangle
from barchan.spaces.mixed import MixedSpace


@pytest.fixture(scope="module")
def square() -> MixedSpace:
    return MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (3, 3)))


def _rotated(mesh, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return type(mesh)(turn @ mesh.p, mesh.t).with_boundaries(
        {name: mesh.boundaries[name] for name in mesh.boundaries}
    ), turn


def test_the_basis_is_orthonormal_and_orthogonal_to_what_is_prescribed(square):
    mesh, _ = _rotated(square.mesh, 0.4)
    space = MixedSpace(mesh)
    conditions = {"left": FreeSlip(), "bottom": NoSlip(), "top": Velocity((0.3, None)), "right": FreeSlip()}
    reduction = reduce(space, conditions)
    basis, rows = reduction.basis, reduction.directions
    assert abs(basis.T @ basis - np.eye(basis.shape[1])).max() < 1e-12
    assert abs(rows @ basis).max() < 1e-12
    assert basis.shape[1] + rows.shape[0] == space.size
    v = reduction.expand(np.random.default_rng(0).standard_normal(basis.shape[1]))
    assert v[space.dofs("bottom")] == pytest.approx(0.0)
    normal = -np.array([np.cos(0.4), np.sin(0.4)])
    inner = np.setdiff1d(space.boundary_nodes("left"), space.boundary_nodes("bottom"))
    inner = np.setdiff1d(inner, space.boundary_nodes("top"))
    assert abs(v.reshape(-1, 2)[inner] @ normal).max() < 1e-12
    assert abs(v.reshape(-1, 2)[inner]).max() > 0.1


def test_reduced_matrices_are_those_of_the_basis(square):
    mesh, _ = _rotated(square.mesh, 0.4)
    for space in (square, MixedSpace(mesh)):
        reduction = reduce(space, {"left": FreeSlip(), "bottom": NoSlip()})
        A, T = space.viscous(1.0), reduction.basis
        assert (reduction.free is not None) == (space is square)
        assert abs(reduction.square(A) - T.T @ A @ T).max() < 1e-12
        assert abs(reduction.columns(space.rates) - space.rates @ T).max() < 1e-12
        load = np.arange(float(space.size))
        assert reduction.restrict(load) == pytest.approx(T.T @ load)


def test_no_slip_beats_the_lid_at_the_corners_whatever_the_order(square):
    walls = dict.fromkeys(("left", "right", "bottom"), NoSlip())
    lid = {"top": Velocity((1.0, 0.0))}
    first = reduce(square, lid | walls).prescribed
    assert first == pytest.approx(reduce(square, walls | lid).prescribed)
    v = square.vertex_velocities(first)
    corner = square.mesh.p[1] == 1.0
    corner &= (square.mesh.p[0] == 0.0) | (square.mesh.p[0] == 1.0)
    assert v[corner] == pytest.approx(0.0)
    assert v[(square.mesh.p[1] == 1.0) & ~corner] == pytest.approx(np.array([[1.0, 0.0]] * 2))


def test_among_equals_the_later_part_wins_and_whole_velocities_beat_components(square):
    corner = (square.mesh.p == 1.0).all(axis=0)
    for names in (("top", "right"), ("right", "top")):
        values = {"top": Velocity((1.0, 0.0)), "right": Velocity((0.0, 2.0))}
        reduction = reduce(square, {name: values[name] for name in names})
        expected = np.asarray(values[names[1]].value)
        assert square.vertex_velocities(reduction.prescribed)[corner][0] == pytest.approx(expected)
    reduction = reduce(square, {"top": Velocity((1.0, 0.5)), "right": Velocity((None, -7.0))})
    assert square.vertex_velocities(reduction.prescribed)[corner][0] == pytest.approx([1.0, 0.5])
    reduction = reduce(square, {"top": Velocity((None, 0.5)), "right": Velocity((0.25, None))})
    assert square.vertex_velocities(reduction.prescribed)[corner][0] == pytest.approx([0.25, 0.5])


def test_prescribed_fields_are_interpolated(square):
    field = lambda x: np.stack([x[:, 1] * (1 - x[:, 1]), 0 * x[:, 0]], axis=1)  # noqa: E731
    prescribed = reduce(square, {"left": Velocity(field)}).prescribed
    nodes = square.boundary_nodes("left")
    assert prescribed.reshape(-1, 2)[nodes] == pytest.approx(field(square.nodes[nodes]))
    single = reduce(square, {"left": Velocity((lambda x: x[:, 1], None))})
    assert single.prescribed[square.dofs("left", 0)] == pytest.approx(square.nodes[nodes, 1])
    assert not np.isin(square.dofs("left", 0), single.free).any()
    assert np.isin(square.dofs("left", 1), single.free).all()


def test_free_slip_on_a_curved_part_lets_nothing_through_in_total():
    space = MixedSpace(channel_with_cylinder(1.0, 4.0, 2.0, 2.0, 150))
    reduction = reduce(space, {"cylinder": FreeSlip()})
    v = reduction.expand(np.random.default_rng(3).standard_normal(reduction.basis.shape[1]))
    nodes = space.boundary_nodes("cylinder")
    assert space.size - reduction.basis.shape[1] == len(nodes)
    assert abs(space.flux("cylinder") @ v) < 1e-10


def test_corners_of_a_slip_part_hold_every_direction():
    mesh = skfem.MeshTri().refined(2).with_boundaries({"walls": lambda x: (x[0] == 0.0) | (x[1] == 0.0)})
    space = MixedSpace(mesh)
    reduction = reduce(space, {"walls": Symmetry()})
    corner = np.flatnonzero((space.nodes == 0.0).all(axis=1))[0]
    assert not np.isin([2 * corner, 2 * corner + 1], reduction.free).any()
    assert space.size - len(reduction.free) == 2 * 9
    cube = MixedSpace(box((0, 0, 0), (1, 1, 1), (1, 1, 1)))
    slip = reduce(cube, dict.fromkeys(("left", "front", "bottom"), FreeSlip()))
    assert cube.size - len(slip.free) == 3 * 9


def test_slanted_slip_in_space_leaves_the_tangents_free():
    """A turned cube: two free tangents on a face, one along an edge of two faces, none where three faces meet."""
    mesh = box((0, 0, 0), (1, 1, 1), (1, 1, 1))
    turn = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    turned = type(mesh)(turn @ mesh.p, mesh.t).with_boundaries(dict(mesh.boundaries))
    conditions = dict.fromkeys(("left", "front", "bottom"), FreeSlip())
    space, straight = MixedSpace(turned), MixedSpace(mesh)
    reduction, aligned = reduce(space, conditions), reduce(straight, conditions)
    assert aligned.free is not None and reduction.free is None
    assert reduction.basis.shape == aligned.basis.shape
    assert abs(reduction.basis.T @ reduction.basis - np.eye(reduction.basis.shape[1])).max() < 1e-12
    v = reduction.expand(np.random.default_rng(5).standard_normal(reduction.basis.shape[1]))
    for axis, name in enumerate(("left", "front", "bottom")):
        nodes = space.boundary_nodes(name)
        assert abs(v.reshape(-1, 3)[nodes] @ turn[:, axis]).max() < 1e-12


def test_rigid_motions_left_free_are_counted(square):
    assert free_rigid_motions(square, reduce(square, {})) == 3
    assert free_rigid_motions(square, reduce(square, {"bottom": FreeSlip()})) == 1
    assert free_rigid_motions(square, reduce(square, {"bottom": FreeSlip(), "left": FreeSlip()})) == 0
    cube = MixedSpace(box((0, 0, 0), (1, 1, 1), (1, 1, 1)))
    assert free_rigid_motions(cube, reduce(cube, {"bottom": FreeSlip()})) == 3


@pytest.mark.parametrize(
    ("conditions", "inflow"),
    [
        (
            {"left": Velocity((1.0, 0.0)), "right": NoSlip(), "top": FreeSlip(), "bottom": FreeSlip()},
            "left",
        ),
        (
            {
                "left": Velocity((1.0, None)),
                "right": Velocity((0.5, 0.0)),
                "top": NoSlip(),
                "bottom": NoSlip(),
            },
            "left",
        ),
        (
            dict.fromkeys(("left", "right", "bottom"), FrictionalWall(0.3)) | {"top": Velocity((0.0, -1.0))},
            "top",
        ),
        (
            dict.fromkeys(("left", "right", "top"), FreeSlip()) | {"bottom": FrictionalWall(0.3, (0.0, 1.0))},
            "bottom",
        ),
    ],
)
def test_inflow_into_a_closed_domain_is_refused_and_its_part_named(square, conditions, inflow):
    with pytest.raises(InputError, match=rf"conditions\.{inflow} = inflow of"):
        DenseFlow(square, Material(), conditions)


def test_balanced_or_open_domains_are_accepted(square):
    through = {
        "left": Velocity((1.0, 0.0)),
        "right": Velocity((1.0, 0.0)),
        "top": FreeSlip(),
        "bottom": FreeSlip(),
    }
    DenseFlow(square, Material(), through)
    DenseFlow(square, Material(), {name: through[name] for name in ("left", "top", "bottom")})
    opening = through | {"right": Velocity((2.0, 0.0))}
    DenseFlow(square, Material(), opening)


def test_data_that_squeeze_one_cell_are_refused_by_the_existence_criterion():
    """The domain is open, so no balance over its boundary tells; a proof of infeasibility does (criterion H(mu))."""
    mesh = rectangle((0.0, 0.0), (1.0, 1.0), (3, 3), diagonals="same")
    space = MixedSpace(mesh, "P1", "P0")
    corner = {"bottom": NoSlip(), "right": Velocity((0.0, -1.0))}
    flow = DenseFlow(space, Material(mu=0.5), corner)
    with pytest.raises(
        InputError, match="conditions = bottom, right: must be compatible: no solution exists"
    ):
        flow.solve(1e-6, "interior_point", check_existence=True)


def test_bad_conditions_are_refused_by_name(square):
    material = Material()
    with pytest.raises(InputError, match="boundary = lid: must be one of"):
        DenseFlow(square, material, {"lid": NoSlip()})
    with pytest.raises(InputError, match=r"conditions\.top"):
        DenseFlow(square, material, {"top": "no slip"})
    with pytest.raises(InputError, match="velocity"):
        DenseFlow(square, material, {"top": Velocity((1.0, 0.0, 0.0))})
    with pytest.raises(InputError, match="velocity"):
        DenseFlow(square, material, {"top": Velocity((np.nan, 0.0))})
    with pytest.raises(InputError, match="gravity"):
        DenseFlow(square, material, {"top": NoSlip()}, gravity=(0.0, 0.0, -1.0))
    with pytest.raises(InputError, match=r"wall\.mu"):
        FrictionalWall(-0.1)
    with pytest.raises(InputError, match="stress"):
        DenseFlow(square, material, {"top": NoSlip(), "left": Stress(np.eye(3))}).problem()
    with pytest.raises(InputError, match="pressure"):
        DenseFlow(square, material, {"top": NoSlip(), "left": Pressure(np.ones(7))}).problem()
    with pytest.raises(InputError, match="rigid motions"):
        DenseFlow(square, material, {"bottom": FreeSlip()}).solve(1e-3)
