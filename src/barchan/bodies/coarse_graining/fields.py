"""Fields of a granular medium from its grains and contact forces (seed C, 3.3.1; Goldhirsch, Granular Matter 12, 2010).

They satisfy the balances of mass and momentum exactly, for any coarse-graining function and at any resolution:
dj/dt = -div(rho u u) - div(sigma) + F_b + rho g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.coarse_graining import _kernels
from barchan.bodies.coarse_graining.images import Mirror, Periodic, Sources, with_images
from barchan.bodies.coarse_graining.interactions import Grains, Interactions
from barchan.bodies.coarse_graining.kernels import Heaviside, Kernel
from barchan.bodies.coarse_graining.rheology import effective_friction, inertial_number
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
_BINS_PER_ITEM = 4


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields at q points.

    points (q, m) [m]. volume_fraction (q,). density (q,) [kg/m^d]. momentum (q, d) [kg m/s / m^d].
    kinetic_stress, contact_stress (q, d, d) [Pa] : compression positive, first index that of the force.
    fabric (q, d, d) : its trace over the volume fraction is the coordination number. boundary_force (q, d) [N/m^d] : of walls.
    density_gradient (q, d), momentum_gradient (q, d, d) : d/dx_j last; zero along axes averaged over, and for Heaviside NaN.
    """

    points: Vector
    volume_fraction: Vector
    density: Vector
    momentum: Vector
    kinetic_stress: Vector
    contact_stress: Vector
    fabric: Vector
    boundary_force: Vector
    density_gradient: Vector
    momentum_gradient: Vector

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.momentum.shape[1])

    @property
    def velocity(self) -> Vector:
        """u = j / rho (q, d) [m/s]; NaN where there is no mass."""
        return _per(self.momentum, self.density)

    @property
    def stress(self) -> Vector:
        """Kinetic and contact stress together (q, d, d) [Pa]."""
        return self.kinetic_stress + self.contact_stress

    @property
    def pressure(self) -> Vector:
        """Tr(stress) / d (q,) [Pa]."""
        trace: Vector = np.trace(self.stress, axis1=1, axis2=2) / self.dimension
        return trace

    @property
    def temperature(self) -> Vector:
        """Granular temperature Tr(kinetic stress) / (d rho) (q,) [m^2/s^2]; NaN where there is no mass.

        Fluctuations are those about the velocity at the point, so shear across the kernel counts too.
        """
        return _per(np.trace(self.kinetic_stress, axis1=1, axis2=2) / self.dimension, self.density)

    @property
    def coordination(self) -> Vector:
        """Coordination number Tr(fabric) / volume fraction (q,); NaN where there is no grain."""
        return _per(np.trace(self.fabric, axis1=1, axis2=2), self.volume_fraction)

    @property
    def velocity_gradient(self) -> Vector:
        """du_i/dx_j (q, d, d) [1/s]; NaN where there is no mass."""
        outer = self.velocity[:, :, None] * self.density_gradient[:, None, :]
        return _per(self.momentum_gradient - outer, self.density)

    @property
    def friction(self) -> Vector:
        """|Dev sigma| / p (q,), see `rheology`."""
        return effective_friction(self.stress)

    def inertial_number(self, grain_diameter: float, grain_density: float) -> Vector:
        """|Dev D| d sqrt(rho / p) (q,), see `rheology`; NaN where there is no mass."""
        gradient = self.velocity_gradient
        empty = np.isnan(gradient).any(axis=(1, 2))
        number = inertial_number(np.nan_to_num(gradient), self.pressure, grain_diameter, grain_density)
        return np.where(empty, np.nan, number)


def coarse_grain(
    points: ArrayLike,
    grains: Grains,
    interactions: Interactions,
    kernel: Kernel,
    axes: Sequence[int] | None = None,
    area: float = 1.0,
    periodic: Periodic | None = None,
    mirrors: Sequence[Mirror] = (),
) -> Fields:
    """Fields at points (q, m) [m].

    axes : the m axes along which fields are resolved (default: all d); over the others they are averaged, these having the
    `area` [m^(d-m)]. periodic : images to add. mirrors : walls whose mirror images are added, so that no mass is lost
    behind them.
    """
    resolved = _axes(axes, grains.dimension)
    at = inputs.table("points", points, (1, 2, 3), 0)
    if at.shape[1] != len(resolved):
        raise InputError("points", at.shape, f"an array of shape (n, {len(resolved)})")
    sources = _sources(at, resolved, grains, interactions, kernel, periodic, mirrors)
    ones = (np.ones(len(sources.masses)), np.ones(len(sources.starts)), np.ones(len(sources.points)))
    return _fields(at, resolved, sources, kernel, inputs.positive("area", area), ones)


def coarse_grain_on_grid(
    lower: ArrayLike,
    upper: ArrayLike,
    counts: Sequence[int],
    grains: Grains,
    interactions: Interactions,
    kernel: Kernel,
    axes: Sequence[int] | None = None,
    area: float = 1.0,
) -> Fields:
    """Fields at the centres of the cells of a grid, rows as in a C array of shape `counts`.

    The weights of each grain and each branch are scaled so that their sum over the grid is exactly one: the sums of
    density, momentum and contact stress times the volume of a cell are the mass, the momentum and the virial of the
    grains. InputError when a grain or a branch meets no centre: the grid is too small or too coarse for the kernel.
    """
    resolved = _axes(axes, grains.dimension)
    m = len(resolved)
    low, high = inputs.vector("lower", lower, (m,)), inputs.vector("upper", upper, (m,))
    numbers = np.array(counts, dtype=np.int64)
    if numbers.shape != (m,) or np.any(numbers < 1):
        raise InputError("counts", list(counts), f"{m} whole numbers >= 1")
    if np.any(high <= low):
        raise InputError("upper", high.tolist(), f"above {low.tolist()}")
    edges = (high - low) / numbers
    lines = [low[k] + (np.arange(numbers[k]) + 0.5) * edges[k] for k in range(m)]
    at = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, m)
    sources = Sources.of(grains, interactions)
    volume = float(np.prod(edges))
    searched = _bins(_padded(at), kernel.reach)
    parts = (
        ("grain", sources.positions, np.zeros_like(sources.positions)),
        ("branch of contact", sources.starts, sources.branches),
        ("contact", sources.points, np.zeros_like(sources.points)),
    )
    scales = []
    for name, places, branches in parts:
        totals = np.zeros(len(places))
        _kernels.total_weights(
            _padded(at), *searched, _padded(places[:, resolved]), _padded(branches[:, resolved]),
            kernel.numbers(m), totals,
        )  # fmt: skip
        if np.any(totals == 0.0):
            missed = f"fine and large enough: {name} {int(np.argmin(totals))} meets no cell centre"
            raise InputError("counts", numbers.tolist(), missed)
        scales.append(1.0 / (volume * totals))
    return _fields(
        at, resolved, sources, kernel, inputs.positive("area", area), (scales[0], scales[1], scales[2])
    )


def _fields(
    at: Vector,
    axes: list[int],
    sources: Sources,
    kernel: Kernel,
    area: float,
    scales: tuple[Vector, Vector, Vector],
) -> Fields:
    d, q = sources.positions.shape[1], len(at)
    points, numbers = _padded(at), kernel.numbers(len(axes))
    places = _padded(sources.positions[:, axes])
    grain = np.zeros((q, 26))
    _kernels.grain_sums(
        points, *_bins(places, kernel.reach), places, _padded(sources.velocities),
        sources.masses, sources.volumes, scales[0], numbers, grain,
    )  # fmt: skip
    branches = _padded(sources.branches[:, axes])
    middles = _padded(sources.starts[:, axes]) - 0.5 * branches
    longest = float(np.max(np.linalg.norm(branches, axis=1), initial=0.0))
    full = (_padded(sources.forces), _padded(sources.branches), _padded(sources.normals))
    vectors = np.concatenate([*full, sources.weights[:, None]], axis=1)
    contact = np.zeros((q, 18))
    _kernels.branch_sums(
        points,
        *_bins(middles, kernel.reach + 0.5 * longest),
        middles,
        branches,
        vectors,
        scales[1],
        longest,
        numbers,
        contact,
    )
    wall = sources.walls
    marks = _padded(sources.points[wall][:, axes])
    push = np.zeros((q, 26))
    _kernels.grain_sums(
        points, *_bins(marks, kernel.reach), marks, _padded(sources.forces[wall]),
        np.ones(len(marks)), np.zeros(len(marks)), scales[2][wall], numbers, push,
    )  # fmt: skip
    grain, contact, push = grain / area, contact / area, push / area
    density, momentum = grain[:, 1], grain[:, 2 : 2 + d]
    velocity = np.nan_to_num(_per(momentum, density))
    second = _matrix(grain[:, 5:14], d)
    kinetic = second - density[:, None, None] * velocity[:, :, None] * velocity[:, None, :]
    slopes, gradients = np.zeros((q, d)), np.zeros((q, d, d))
    missing = np.nan if isinstance(kernel, Heaviside) else 0.0
    slopes[:, axes] = grain[:, 14 : 14 + len(axes)] + missing
    gradients[:, :, axes] = grain[:, 17:26].reshape(q, 3, 3)[:, :d, : len(axes)] + missing
    return Fields(
        at, grain[:, 0], density, momentum, kinetic, _matrix(contact[:, :9], d), _matrix(contact[:, 9:], d),
        push[:, 2 : 2 + d], slopes, gradients,
    )  # fmt: skip


def _sources(
    at: Vector,
    axes: list[int],
    grains: Grains,
    interactions: Interactions,
    kernel: Kernel,
    periodic: Periodic | None,
    mirrors: Sequence[Mirror],
) -> Sources:
    """Everything whose kernel reaches the points; axes averaged over are not cut, and have no images."""
    sources = Sources.of(grains, interactions)
    d = grains.dimension
    lower, upper = np.full(d, -np.inf), np.full(d, np.inf)
    if len(at):
        lower[axes], upper[axes] = np.min(at, axis=0), np.max(at, axis=0)
    if periodic is not None:
        useful = np.any(periodic.edges[:, axes] != 0.0, axis=1)
        edges, velocities = periodic.edges[useful], periodic.velocities[useful]
        periodic = Periodic(edges, velocities) if np.any(useful) else None
    return with_images(sources, lower, upper, kernel.reach, periodic, mirrors)


def _bins(
    places: Vector, size: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Vector, float, NDArray[np.int64]]:
    """Places (n, 3) sorted into bins at least `size` wide: order, starts, lower corner, width and counts."""
    if not len(places):
        none = np.zeros(0, dtype=np.int64)
        return none, np.zeros(2, dtype=np.int64), np.zeros(3), size, np.ones(3, dtype=np.int64)
    lower, upper = np.min(places, axis=0), np.max(places, axis=0)
    while np.prod((upper - lower) / size + 1.0) > _BINS_PER_ITEM * len(places) + 64:
        size *= 1.26
    counts = (np.floor((upper - lower) / size) + 1).astype(np.int64)
    order, starts = _kernels.bins(places, lower, size, counts)
    return order, starts, lower, size, counts


def _axes(axes: Sequence[int] | None, dimension: int) -> list[int]:
    chosen = list(range(dimension)) if axes is None else [int(a) for a in axes]
    if not chosen or len(set(chosen)) != len(chosen) or min(chosen) < 0 or max(chosen) >= dimension:
        raise InputError("axes", chosen, f"some of {list(range(dimension))}, each once")
    return chosen


def _padded(vectors: Vector) -> Vector:
    """(n, 3), zeros behind what is given."""
    padded = np.zeros((len(vectors), 3))
    padded[:, : vectors.shape[1]] = vectors
    return padded


def _matrix(rows: Vector, dimension: int) -> Vector:
    return rows.reshape(-1, 3, 3)[:, :dimension, :dimension]


def _per(values: Vector, density: Vector) -> Vector:
    shape = (-1,) + (1,) * (values.ndim - 1)
    by = np.broadcast_to(density.reshape(shape), values.shape)
    return np.divide(values, by, out=np.full(values.shape, np.nan), where=by > 0.0)
