"""The model of Super-Helices (Bertails et al. 2006; seed B, 4.2): material, energies, and the linearised implicit step (2.16).

A fibre is an inextensible Kirchhoff rod, held at its root. Its coordinates are, piece by piece, the twist and two curvatures
[1/m] in its own frame: 3 a piece, no constraint, the elastic energy exactly quadratic. Places, frames and their derivatives
are exact; mass and weight are integrated with Gauss points along each piece. Rotational inertia is left out, as in the paper.

The step keeps the velocities u of the points of quadrature: with J those of the coordinates at the start of the step,

    sum m J^T (J v + d - u^k) / dt = -K (q^k + dt v - q0) - D v + weight + H^T r,    u^(k+1) = J v + d,

d [m/s] being what the given motion of the root does over the step. Without other forces the step projects u^k on the motions of
the fibre: Coriolis' and centrifugal forces are in the difference of J from step to step, and kinetic energy never grows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.fibres.helices import _step
from barchan.bodies.fibres.helices.pieces import Pieces, Placed
from barchan.bodies.fibres.helices.shape import HelixShape
from barchan.bodies.fibres.model import FibreSystem, PointRows, Vector, Whole
from barchan.bodies.fibres.roots import RootMotion
from barchan.bodies.rigid import inputs
from barchan.errors import InputError


@dataclass(frozen=True, eq=False)
class Helices:
    """A model of f Super-Helices of p pieces in all (a `FibreModel`).

    Parameters
    ----------
    lengths, firsts : (p,) lengths of the pieces [m] and (f + 1,) first piece of each fibre; see `even_pieces`.
    roots : how they are held (`fibres.roots`), clamped; the frames there are those of the pieces.
    radius : [m], of all or (f,): the semi-axis of the section along its first direction, and that of contact.
    density [kg/m^3], young [Pa], poisson : of the material.
    natural : (p, 3) natural twist and curvatures [1/m]; default straight.  curvatures : (p, 3) at the start; default natural.
    second_radius : [m], of all or (f,): the semi-axis along the second direction of an elliptic section; default `radius`.
    internal_damping : [s], moments of the rates of curvature over those of curvature (Kelvin and Voigt's).
    air_friction : [kg/(m s)], drag on a metre of fibre over its velocity.
    nodes_per_piece : segments of the polyline of contact on each piece.  quadrature : Gauss points on each piece.

    Raises InputError for arrays that do not fit, numbers out of range, a radius larger than a piece, roots not clamped.
    """

    lengths: Vector
    firsts: Whole
    roots: RootMotion
    radius: float | Vector
    density: float
    young: float
    poisson: float = 0.3
    natural: Vector | None = None
    curvatures: Vector | None = None
    second_radius: float | Vector | None = None
    internal_damping: float = 0.0
    air_friction: float = 0.0
    nodes_per_piece: int = 4
    quadrature: int = 4

    def __post_init__(self) -> None:
        store = object.__setattr__
        fibres = self.pieces.fibres
        if len(self.roots) != fibres:
            raise InputError("roots", len(self.roots), f"those of {fibres} fibres")
        if self.roots.hold != "clamped":
            raise InputError("roots.hold", self.roots.hold, '"clamped" for Super-Helices')
        for name in ("density", "young"):
            store(self, name, inputs.positive(name, getattr(self, name)))
        for name in ("internal_damping", "air_friction"):
            store(self, name, inputs.not_negative(name, getattr(self, name)))
        if not np.isfinite(self.poisson) or not -1.0 < self.poisson <= 0.5:
            raise InputError("poisson", self.poisson, "a number above -1, 1/2 at most")
        for name in ("nodes_per_piece", "quadrature"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= 64:
                raise InputError(name, value, "a whole number from 1 to 64")
        for name in ("natural", "curvatures"):
            if getattr(self, name) is not None:
                store(self, name, self._checked_curvatures(name, getattr(self, name)))
        for name in ("radius", "second_radius"):
            if getattr(self, name) is not None:
                store(self, name, self._checked_radius(name, getattr(self, name)))

    def _checked_curvatures(self, name: str, value: ArrayLike) -> Vector:
        array = np.ascontiguousarray(np.array(value, dtype=np.float64))
        if array.shape != (len(self.pieces), 3) or not np.all(np.isfinite(array)):
            raise InputError(name, array.shape, f"finite curvatures ({len(self.pieces)}, 3) (1/m)")
        return array

    def _checked_radius(self, name: str, value: ArrayLike) -> Vector:
        try:
            radii = np.broadcast_to(np.asarray(value, dtype=np.float64), (self.pieces.fibres,)).copy()
        except (TypeError, ValueError):
            raise InputError(name, value, "a number, or one a fibre (m)") from None
        if not np.all(np.isfinite(radii)) or np.any(radii <= 0.0):
            raise InputError(name, value, "positive (m)")
        shortest = np.minimum.reduceat(self.pieces.lengths, self.pieces.firsts[:-1])
        if np.any(radii > shortest):
            k = int(np.argmax(radii > shortest))
            raise InputError(
                name, float(radii[k]), f"at most {shortest[k]:g}, the shortest piece of fibre {k}"
            )
        return radii

    @cached_property
    def pieces(self) -> Pieces:
        """How the fibres are cut."""
        return Pieces(self.lengths, self.firsts)

    @property
    def radii(self) -> Vector:
        """(f,) radii of contact [m]."""
        return np.asarray(self.radius)

    @property
    def offsets(self) -> Whole:
        """(f + 1,) first velocity of each fibre."""
        return 3 * self.pieces.firsts

    @property
    def node_offsets(self) -> Whole:
        """(f + 1,) first node of each fibre: `nodes_per_piece` a piece, and the root."""
        return self._nodes[2]

    @cached_property
    def natural_curvatures(self) -> Vector:
        """(p, 3) natural twist and curvatures [1/m]."""
        return np.zeros((len(self.pieces), 3)) if self.natural is None else np.asarray(self.natural)

    @cached_property
    def line_densities(self) -> Vector:
        """(f,) mass of a metre of each fibre [kg/m]."""
        return self.density * np.pi * self.radii * self._second

    @cached_property
    def stiffness(self) -> Vector:
        """(p, 3) energy 1/2 stiffness (q - q0)^2 [N m^3]: stiffness of twist and bending times the length of the piece.

        Of an elliptic section with semi-axes a, b along its directions: E pi a b^3 / 4 for curvature 1, E pi a^3 b / 4 for
        curvature 2, G pi a^3 b^3 / (a^2 + b^2) for twist.
        """
        a, b = self.radii, self._second
        shear = self.young / (2.0 * (1.0 + self.poisson))
        twist = shear * np.pi * a**3 * b**3 / (a**2 + b**2)
        bending = 0.25 * self.young * np.pi * a * b
        moduli = np.stack([twist, bending * b**2, bending * a**2], axis=1)
        return np.ascontiguousarray(moduli[self.pieces.owners] * self.pieces.lengths[:, None])

    @property
    def _second(self) -> Vector:
        return self.radii if self.second_radius is None else np.asarray(self.second_radius)

    @cached_property
    def _points(self) -> tuple[Whole, Vector, Vector]:
        return self.pieces.quadrature(self.quadrature)

    @cached_property
    def _masses(self) -> Vector:
        """(k,) of the points of quadrature [kg]."""
        return self._points[2] * self.line_densities[self.pieces.owners[self._points[0]]]

    @cached_property
    def _nodes(self) -> tuple[Whole, Vector, Whole]:
        return self.pieces.nodes(self.nodes_per_piece)

    @cached_property
    def _block_offsets(self) -> Whole:
        return np.concatenate([[0], np.cumsum(np.diff(self.offsets) ** 2)]).astype(np.int64)

    @cached_property
    def _point_offsets(self) -> Whole:
        return self.quadrature * np.arange(len(self.pieces) + 1, dtype=np.int64)

    @property
    def _start(self) -> Vector:
        return self.natural_curvatures if self.curvatures is None else np.asarray(self.curvatures)

    def with_natural(self, natural: ArrayLike, curvatures: ArrayLike | None = None) -> Helices:
        """The same fibres with other natural curvatures (p, 3) [1/m]; `curvatures` at the start, default those of this one."""
        start = self._start if curvatures is None else curvatures
        return replace(self, natural=np.asarray(natural, float), curvatures=np.asarray(start, float))

    def started(self) -> HelixShape:
        """The fibres where they start, at rest."""
        still = np.zeros((self.pieces.fibres, 3))
        points = np.zeros((len(self._points[0]), 3))
        return HelixShape(0.0, self._start.copy(), np.zeros(self._start.size), points, still, still.copy())

    def restored(self, arrays: Mapping[str, NDArray[Any]]) -> HelixShape:
        """The state that `arrays()` of a shape wrote."""
        given = {name: np.ascontiguousarray(array, dtype=np.float64) for name, array in arrays.items()}
        if given["curvatures"].shape != (len(self.pieces), 3):
            raise InputError(
                "curvatures", given["curvatures"].shape, f"({len(self.pieces)}, 3), as these fibres"
            )
        time = float(np.asarray(arrays["time"]))
        return HelixShape(time, **{name: array for name, array in given.items() if name != "time"})

    def placed(self, q: Vector, time: float) -> Placed:
        """The pieces in space at curvatures q (p, 3), with their roots where they are at `time`."""
        return self.pieces.placed(q, *self.roots.at(time))

    def centre_line(self, shape: HelixShape) -> Vector:
        """(n, 3) nodes of all fibres [m]."""
        q = shape.curvatures
        return self.pieces.places(q, self.placed(q, shape.time), *self._nodes[:2])

    def node_velocities(self, shape: HelixShape) -> Vector:
        """(n, 3) velocities of the nodes [m/s]."""
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time)
        pieces, arcs, _ = self._nodes
        fibre = self.pieces.owners[pieces]
        own = self.pieces.velocities(q, shape.velocities, placed, pieces, arcs)
        away = self.pieces.places(q, placed, pieces, arcs) - self.roots.at(shape.time)[0][fibre]
        return own + shape.root_velocities[fibre] + np.cross(shape.root_spins[fibre], away)

    def _drift(self, time: float, dt: float, pieces: Whole, places: Vector) -> Vector:
        """(k, 3) what the roots do to points over a step: the move from `time` to `time` + `dt` at frozen curvatures, over dt.

        places : (k, 3) of points on `pieces` (k,) at the end of the step.
        """
        before, turned_from = self.roots.at(time)
        after, turned_to = self.roots.at(time + dt)
        fibre = self.pieces.owners[pieces]
        away = places - after[fibre]
        turned = np.einsum("kij,kj->ki", (turned_from @ np.swapaxes(turned_to, 1, 2))[fibre], away)
        drift: Vector = ((after - before)[fibre] + away - turned) / dt
        return drift

    def system(self, shape: HelixShape, dt: float, gravity: Vector) -> FibreSystem:
        """The implicit step of `dt` seconds under gravity (3,) [m/s^2], without contacts.

        Of the stiffness of weight the positive part is implicit: what it leaves out lowers the energy at any step.
        """
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time + dt)
        pieces, arcs, weights = self._points
        places = self.pieces.places(q, placed, pieces, arcs)
        drift = self._drift(shape.time, dt, pieces, places)
        offsets, weight = self._block_offsets, np.ascontiguousarray(gravity, dtype=np.float64)
        blocks, forces = np.empty(offsets[-1]), np.empty(3 * len(q))
        _step.step_blocks(
            self.pieces.firsts, self._point_offsets, arcs, self._masses, self.air_friction * weights, places,
            shape.point_velocities, drift, weight, dt, q, self.natural_curvatures, self.stiffness,
            self.internal_damping * self.stiffness, placed.starts, placed.frames, placed.psi, placed.chi, np.empty(9 * len(q)),
            np.empty((self.pieces.fibres, 3, 3)), offsets, blocks, forces,
        )  # fmt: skip
        if np.any(weight):
            stiffness = self._weight_blocks(q, placed, places, weight)
            blocks += dt * _positive_parts(stiffness, offsets, np.diff(self.offsets))
        return FibreSystem(blocks, offsets, forces)

    def rows(self, shape: HelixShape, dt: float, fibre: Whole, segment: Whole, share: Vector) -> PointRows:
        """How the points at `share` (0 to 1) of the `segment` of `fibre` move over the step of dt: exact on the polyline."""
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time + dt)
        node = self.node_offsets[fibre] + segment
        both = np.concatenate([node, node + 1])
        pieces, arcs = self._nodes[0][both], self._nodes[1][both]
        places = self.pieces.places(q, placed, pieces, arcs)
        values, starts = self.pieces.motions(q, placed, pieces, arcs, places)
        drift = self._drift(shape.time, dt, pieces, places)
        half, second = len(node), share[:, None]
        weights = np.repeat(share, 3 * np.diff(self.offsets)[fibre])
        mixed = (1.0 - weights) * values[: weights.size] + weights * values[weights.size :]
        return PointRows(mixed, starts[:half], (1.0 - second) * drift[:half] + second * drift[half:])

    def moved(self, shape: HelixShape, velocities: Vector, dt: float) -> HelixShape:
        """The fibres after a step of `dt` at these end velocities (m,)."""
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time + dt)
        pieces, arcs, _ = self._points
        places = self.pieces.places(q, placed, pieces, arcs)
        points = self.pieces.velocities(q, velocities, placed, pieces, arcs)
        points += self._drift(shape.time, dt, pieces, places)
        rates = np.array(velocities, dtype=np.float64)
        linear, spins = self.roots.velocities(shape.time, dt)
        return HelixShape(shape.time + dt, q + dt * rates.reshape(-1, 3), rates, points, linear, spins)

    def kinetic_energy(self, shape: HelixShape) -> float:
        """[J], of the velocities of the points of quadrature."""
        return float(0.5 * np.sum(self._masses[:, None] * shape.point_velocities**2))

    def elastic_energy(self, shape: HelixShape) -> float:
        """[J]."""
        return float(0.5 * np.sum(self.stiffness * (shape.curvatures - self.natural_curvatures) ** 2))

    def potential_energy(self, shape: HelixShape, gravity: Vector) -> float:
        """Elastic energy and that of weight [J], the latter zero at the origin."""
        q = shape.curvatures
        places = self.pieces.places(q, self.placed(q, shape.time), *self._points[:2])
        return self.elastic_energy(shape) - float(self._masses @ (places @ np.asarray(gravity, dtype=float)))

    def weight_forces(self, shape: HelixShape, gravity: Vector) -> Vector:
        """(m,) generalised forces of weight [N m^2]: minus the gradient of its energy."""
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time)
        pieces, arcs, _ = self._points
        places = self.pieces.places(q, placed, pieces, arcs)
        values, _ = self.pieces.motions(q, placed, pieces, arcs, places)
        orders = self.pieces.orders(pieces)
        pulls = np.repeat(
            (self._masses[:, None] * np.asarray(gravity, dtype=float)).reshape(-1), np.repeat(orders, 3)
        )
        begins = np.repeat(self.offsets[self.pieces.owners[pieces]], 3)
        forces = np.bincount(_ranges(begins, np.repeat(orders, 3)), values * pulls, 3 * len(q))
        return cast(Vector, forces)

    def weight_stiffness(self, shape: HelixShape, gravity: Vector) -> Vector:
        """Second derivatives of the energy of weight by the coordinates [N m^3], block after block as in `FibreSystem`."""
        q, placed = shape.curvatures, self.placed(shape.curvatures, shape.time)
        places = self.pieces.places(q, placed, *self._points[:2])
        return self._weight_blocks(q, placed, places, np.ascontiguousarray(gravity, dtype=np.float64))

    def _weight_blocks(self, q: Vector, placed: Placed, places: Vector, gravity: Vector) -> Vector:
        out = np.empty(self._block_offsets[-1])
        _step.weight_stiffness(
            self.pieces.firsts, self._point_offsets, self._points[1], self._masses, places, gravity, q, self.pieces.lengths,
            placed.starts, placed.frames, placed.psi, placed.chi, np.empty((len(q), 3, 3)),
            np.empty((self.pieces.fibres, 3, 4, 3)), self._block_offsets, out,
        )  # fmt: skip
        return out


def _ranges(starts: Whole, sizes: Whole) -> Whole:
    """starts[0], starts[0] + 1, ... sizes[0] numbers, then those from starts[1] on, and so on."""
    whole: Whole = np.arange(int(np.sum(sizes))) + np.repeat(starts - np.cumsum(sizes) + sizes, sizes)
    return whole


def _positive_parts(blocks: Vector, offsets: Whole, orders: Whole) -> Vector:
    """Symmetric blocks, one after another, with their negative eigenvalues made zero."""
    out = np.empty_like(blocks)
    for order in np.unique(orders):
        entries = offsets[:-1][orders == order][:, None] + np.arange(order**2)
        values, vectors = np.linalg.eigh(blocks[entries].reshape(-1, order, order))
        scaled = vectors * np.maximum(values, 0.0)[:, None, :]
        out[entries] = (scaled @ np.swapaxes(vectors, 1, 2)).reshape(len(entries), -1)
    return out
