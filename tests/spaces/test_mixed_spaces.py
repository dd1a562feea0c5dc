"""Mixed velocity-stress spaces: what must hold for every pair of elements (seed B, 6.3)."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import skfem

from barchan.cones import chi_inverse
from barchan.errors import InputError
from barchan.spaces.mixed import MixedSpace

STRESSES = ("P0", "P1", "P1d", "P2d")


def _bent(mesh):
    """The same mesh with its vertices moved, so that cells differ and quadrilaterals are no parallelograms."""
    return type(mesh)(mesh.p + 0.04 * np.sin(5.0 * mesh.p[::-1]), mesh.t)


MESHES = {
    "triangles": _bent(skfem.MeshTri().refined(2)),
    "quadrilaterals": _bent(skfem.MeshQuad().refined(2)),
    "tetrahedra": _bent(skfem.MeshTet().refined(1)),
}
VELOCITIES = {
    "triangles": ("P1", "P2", "P3", "P4"),
    "quadrilaterals": ("Q1", "Q2"),
    "tetrahedra": ("P1", "P2"),
}
PAIRS = [(kind, v, s) for kind in MESHES for v in VELOCITIES[kind] for s in STRESSES]
pairs = pytest.mark.parametrize(("kind", "velocity", "stress"), PAIRS)


def _random(space, seed=0):
    return np.random.default_rng(seed).standard_normal(space.size)


@pairs
def test_rates_of_an_affine_velocity_are_exact(kind, velocity, stress):
    space = MixedSpace(MESHES[kind], velocity, stress)
    d = space.dimension
    gradient = np.random.default_rng(1).standard_normal((d, d))
    v = space.interpolate(lambda x: x @ gradient.T + 1.0)
    assert space.strain_rates(v) == pytest.approx(
        np.tile(chi_inverse(gradient), (space.n, 1)), abs=1e-11, rel=0
    )
    assert space.rates.shape == (space.n * space.s, space.size)


@pairs
def test_the_points_carry_the_volume_and_their_cells_hold_them(kind, velocity, stress):
    space = MixedSpace(MESHES[kind], velocity, stress)
    one = space.interpolate(np.eye(space.dimension)[0])
    volume = float(one @ space.mass() @ one)
    assert space.weights.sum() == pytest.approx(volume, rel=1e-12)
    assert space.weights.min() > 0.0
    if stress != "P1":
        low = space.mesh.p.T[space.mesh.t.T[space.cells]].min(axis=1)
        high = space.mesh.p.T[space.mesh.t.T[space.cells]].max(axis=1)
        assert ((space.points > low) & (space.points < high)).all()


@pairs
def test_internal_forces_do_the_work_of_the_stress_field(kind, velocity, stress):
    """H^T lambda . v is the integral of D(v) : chi(lambda) for a stress of the space (B = R^T H, seed B 6.3.4)."""
    space = MixedSpace(MESHES[kind], velocity, stress)
    d = space.dimension
    v = _random(space)
    slope, base = np.random.default_rng(2).standard_normal((2, space.s))
    linear = 0.0 if stress == "P0" else 1.0
    field = lambda x: base + linear * (x @ np.arange(1.0, d + 1.0))[:, None] * slope  # noqa: E731
    fine = space.tables(*space.element.quadrature(7 if d == 3 else 12))
    nodal = v.reshape(-1, d)[space.cell_nodes]
    grad = np.einsum("epkg,ekc->epcg", fine.gradients, nodal)
    rate = chi_inverse(grad).reshape(-1, space.s)
    work = 2.0 * np.einsum("n,ns,ns->", fine.weights.ravel(), rate, field(fine.flat_points))
    assert field(space.points).ravel() @ (space.rates @ v) == pytest.approx(work, rel=1e-9)


@pairs
def test_factored_and_projected_agree_where_both_exist(kind, velocity, stress):
    space = MixedSpace(MESHES[kind], velocity, stress)
    projected = MixedSpace(MESHES[kind], velocity, stress, "projected")
    if space.element.imposed == "projected":
        with pytest.raises(InputError, match="imposed"):
            MixedSpace(MESHES[kind], velocity, stress, "factored")
        return
    R, pinv = space.element.interpolation, space.element.pseudo_inverse
    assert pinv @ R == pytest.approx(np.eye(R.shape[1]), abs=1e-12)
    if R.shape[0] == R.shape[1]:
        assert abs(space.rates - projected.rates).max() < 1e-11
    else:
        # More points than stress unknowns: H itself is one of many with R^T H = B; the projected one has the least norm.
        expand = sp.kron(sp.eye_array(space.mesh.t.shape[1]), sp.kron(R, np.eye(space.s)))
        assert abs(expand.T @ (space.rates - projected.rates)).max() < 1e-11


@pairs
def test_viscosity_is_definite_but_for_rigid_motions(kind, velocity, stress):
    space = MixedSpace(MESHES[kind], velocity, stress)
    A = space.viscous(lambda x: 1.0 + x[:, 0] ** 2)
    assert abs(A - A.T).max() < 1e-12
    values = np.linalg.eigvalsh(A.toarray())
    rigid = {2: 3, 3: 6}[space.dimension]
    assert abs(values[:rigid]).max() < 1e-11 * values[-1]
    assert values[rigid] > 1e-6 * values[-1]


@pytest.mark.parametrize(
    ("kind", "velocity", "stress"),
    [
        ("triangles", "P1", "P0"),
        ("triangles", "P2", "P1d"),
        ("triangles", "P3", "P2d"),
        ("tetrahedra", "P2", "P1d"),
    ],
)
def test_constant_viscosity_is_the_weighted_square_of_the_rates(kind, velocity, stress):
    """With b = 1, v.A v = sum of eta / w_q |H v|^2 when H is exact."""
    space = MixedSpace(MESHES[kind], velocity, stress)
    weight = sp.diags_array(np.repeat(0.7 / space.weights, space.s))
    assert abs(space.viscous(0.7) - space.rates.T @ weight @ space.rates).max() < 1e-11


def test_bulk_weights_the_divergence_alone():
    space = MixedSpace(MESHES["triangles"])
    swelling = space.interpolate(lambda x: x)
    shear = space.interpolate(lambda x: x[:, ::-1])
    area = space.weights.sum()
    for bulk in (0.0, 0.5, 2.0):
        A = space.viscous(3.0, bulk)
        # a = 2 eta (|Dev D|^2 + b / d (div)^2): D = 1 has div = 2; D = offdiagonal 1 has Dev D : Dev D = 2.
        assert swelling @ A @ swelling == pytest.approx(2 * 3.0 * bulk / 2 * 4 * area)
        assert shear @ A @ shear == pytest.approx(2 * 3.0 * 2 * area)


@pytest.mark.parametrize("velocity", ["P1", "P2", "P3", "P4"])
def test_velocities_are_continuous_and_interpolate_their_degree(velocity):
    space = MixedSpace(MESHES["triangles"], velocity)
    degree = int(velocity[1])
    field = lambda x: np.stack([x[:, 0] ** degree, (x[:, 0] - 2 * x[:, 1]) ** degree], axis=1)  # noqa: E731
    v = space.interpolate(field)
    points = space.points
    assert space.at(v, points) == pytest.approx(field(points), abs=1e-12)
    assert space.vertex_velocities(v) == pytest.approx(field(space.mesh.p.T), abs=1e-13)


@pytest.mark.parametrize("kind", list(MESHES))
def test_loads_and_boundary_loads_are_integrals(kind):
    space = MixedSpace(MESHES[kind].with_boundaries({"all": lambda x: x[0] > -np.inf}), VELOCITIES[kind][-1])
    d = space.dimension
    volume = space.weights.sum()
    force = np.arange(1.0, d + 1.0)
    unit = np.eye(d)
    load = space.load(force)
    assert [load @ space.interpolate(e) for e in unit] == pytest.approx(list(force * volume))
    assert space.load(lambda x: np.tile(force, (len(x), 1))) == pytest.approx(load)
    # Gauss: the flux of a linear field through the whole boundary is its divergence times the volume.
    v = space.interpolate(lambda x: x * force)
    assert space.flux("all") @ v == pytest.approx(force.sum() * volume)
    # A uniform pressure pushes nowhere in total; a uniform stress does work on strain only.
    sigma = np.diag(force) + 0.3
    traction = space.boundary_load("all", sigma)
    assert [traction @ space.interpolate(e) for e in unit] == pytest.approx([0.0] * d, abs=1e-12)
    assert traction @ v == pytest.approx((sigma.diagonal() * force).sum() * volume)


@pytest.mark.parametrize("kind", list(MESHES))
def test_wall_rows_measure_normal_and_tangential_velocity(kind):
    mesh = type(MESHES[kind])().refined(1).with_boundaries({"left": lambda x: x[0] < 1e-9})
    space = MixedSpace(mesh, VELOCITIES[kind][-1])
    d = space.dimension
    wall = space.wall("left")
    assert wall.weights.sum() == pytest.approx(1.0)
    assert wall.normals == pytest.approx(np.tile(np.eye(d)[0], (len(wall.weights), 1)))
    assert np.einsum("nab,ncb->nac", wall.frames, wall.frames) == pytest.approx(
        np.tile(np.eye(d), (len(wall.weights), 1, 1))
    )
    v = space.interpolate(lambda x: np.stack([x[:, 1], *[x[:, 0] - x[:, 1] ** 2] * (d - 1)], axis=1))
    rows = (wall.rates @ v).reshape(-1, d) / wall.weights[:, None]
    velocity = space.at(v, wall.points)
    assert rows == pytest.approx(np.einsum("nab,nb->na", wall.frames, velocity), abs=1e-12)


def test_named_unknowns_lie_on_their_part():
    mesh = skfem.MeshTri().refined(2).with_boundaries({"left": lambda x: x[0] == 0.0})
    space = MixedSpace(mesh, "P3")
    dofs = space.dofs("left")
    assert len(dofs) == 2 * (3 * 4 + 1)
    assert (space.nodes[dofs // 2, 0] == 0.0).all()
    assert space.dofs("left", 1) == pytest.approx(dofs[1::2])


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"velocity": "P5"}, "velocity"),
        ({"velocity": "Q2"}, "velocity"),
        ({"stress": "P3d"}, "stress"),
        ({"imposed": "exactly"}, "imposed"),
        ({"velocity": "P4", "stress": "P1d", "imposed": "factored"}, "imposed"),
    ],
)
def test_unknown_elements_are_refused_by_name(arguments, word):
    with pytest.raises(InputError, match=word):
        MixedSpace(MESHES["triangles"], **arguments)


def test_other_meshes_and_unknown_parts_are_refused():
    with pytest.raises(InputError, match="mesh"):
        MixedSpace(skfem.MeshLine())
    space = MixedSpace(skfem.MeshTri().refined(1).with_boundaries({"left": lambda x: x[0] == 0.0}))
    with pytest.raises(InputError, match=r"boundary = lid: must be one of left"):
        space.dofs("lid")
    with pytest.raises(InputError, match="names no boundary"):
        MixedSpace(skfem.MeshTri()).facets("left")
    with pytest.raises(InputError, match="viscosity"):
        space.viscous(-1.0)
    with pytest.raises(InputError, match="force"):
        space.load(np.ones(3))
