"""Energies, forces and implicit systems of discrete elastic rods (Bergou et al. 2010; seed B, Eq. 2.16)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.fibres.model import FibreSystem
from barchan.bodies.fibres.rods import _kernels, ends
from barchan.bodies.fibres.rods.damping import Damping
from barchan.bodies.fibres.rods.natural import Natural
from barchan.bodies.fibres.rods.section import Section
from barchan.bodies.fibres.rods.shape import RodShape
from barchan.bodies.fibres.roots import RootMotion
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

SMALLEST_SHARE_OF_MASS = (
    0.5  # the full Hessian is kept while no motion loses more than this of its inertia to it
)
_SETTLED = 1e-4  # turn of an edge in one iteration that needs no further one
_LARGEST_TURN = 1.0  # of an edge in one iteration


class RodMechanics:
    """What f rods are, and how they resist; `Rods` makes them. Displacements are those of nodes and edges (see `RodShape`).

    node_offsets (f + 1,), offsets (f + 1,) first node, first velocity of each fibre.  free (m,) : displacements that are not
    given.  is_node (all,) : whether a displacement is a node's.  masses (all,) [kg].  rest_lengths (q,), shares (k,) [m].
    iterations : of Newton's method in a step.
    """

    node_offsets: Whole
    offsets: Whole
    free: Whole
    is_node: NDArray[np.bool_]
    section: Section
    damping: Damping
    natural: Natural
    roots: RootMotion
    tips: RootMotion | None
    rest_lengths: Vector
    shares: Vector
    masses: Vector
    iterations: int
    _held: tuple[int, int]
    _block_offsets: Whole
    _edge_fibre: Whole
    _inner_fibre: Whole
    _air: Vector
    _stiffness: Vector

    @property
    def radii(self) -> Vector:
        """(f,) radii [m]."""
        return self.section.radius

    @property
    def size(self) -> int:
        """Number of displacements of all nodes and edges, given ones too: 4 p - f."""
        return int(4 * self.node_offsets[-1]) - len(self.radii)

    # -- energies and forces ------------------------------------------------------------------------------------------

    def kinetic_energy(self, shape: RodShape) -> float:
        """[J], of nodes and of spinning edges, given motions too."""
        return float(0.5 * np.sum(self.masses * shape.motion**2))

    def potential_energy(self, shape: RodShape, gravity: Vector) -> float:
        """Elastic energy and that of weight, zero with all nodes at the origin [J]."""
        weights = self.masses[self.is_node].reshape(-1, 3)
        return float(np.sum(self.elastic_energies(shape)) - np.sum(weights * shape.nodes * gravity))

    def elastic_energies(self, shape: RodShape) -> Vector:
        """(f,) [J]."""
        stiff = self.section.stretching[self._edge_fibre]
        stretching = 0.5 * self.tensions(shape) ** 2 * self.rest_lengths / stiff
        bends, turns = shape.curvatures - self.natural.curvatures, shape.twists - self.natural.twists
        bending = np.einsum("ki,kij,kj->k", bends, self.section.bending[self._inner_fibre], bends)
        turning = self.section.twisting[self._inner_fibre] * turns**2
        energies = np.bincount(self._inner_fibre, 0.5 * (bending + turning) / self.shares, len(self.radii))
        energies += np.bincount(self._edge_fibre, stretching, len(self.radii))
        return np.asarray(energies, dtype=np.float64)

    def elastic_forces(self, shape: RodShape) -> Vector:
        """(all,) minus the derivative of the elastic energy by each displacement [N]."""
        forces, band = np.zeros(self.size), np.zeros((self.size, _kernels.BAND))
        fibres = self._fibres(shape, self.tensions(shape))
        _kernels.elastic_forces(fibres, (1.0, 0.0, 0.0), False, forces, band)
        return forces

    def hessian(self, shape: RodShape) -> sp.csr_array:
        """(all, all) second derivatives of the elastic energy [N/m]."""
        count = _kernels.BAND
        forces, band = np.zeros(self.size), np.zeros((self.size, count))
        fibres = self._fibres(shape, self.tensions(shape))
        _kernels.elastic_forces(fibres, (1.0, 1.0, 1.0), False, forces, band)
        below = [band[k:, k] for k in range(1, count)]
        lower = sp.diags_array(below, offsets=[-k for k in range(1, count)], shape=(self.size, self.size))
        return sp.csr_array(lower + lower.T + sp.diags_array(band[:, 0]))

    def tensions(self, shape: RodShape) -> Vector:
        """(q,) tensions of the edges [N]."""
        strain = np.linalg.norm(self._edges(shape.nodes), axis=1) / self.rest_lengths - 1.0
        return np.asarray(self.section.stretching[self._edge_fibre] * strain, dtype=np.float64)

    # -- motion -------------------------------------------------------------------------------------------------------

    def given_velocities(self, shape: RodShape, dt: float) -> Vector:
        """(all,) velocities of displacements that roots and tips give over a step [m/s], zero elsewhere."""
        if not (np.isfinite(dt) and dt > 0.0):
            raise InputError("dt", dt, "positive [s]")
        motion = np.zeros(self.size)
        now = (self.node_offsets, shape.nodes, shape.directors, self.rest_lengths, self.radii)
        for end, last in ((self.roots, False), (self.tips, True)):
            if end is not None:
                ends.given_velocities(end, last, shape.time, dt, *now, motion)
        return motion

    def displaced(self, shape: RodShape, step: Vector) -> RodShape:
        """`shape` with all displacements moved by `step` (all,) [m]; time and velocities are kept."""
        nodes, directors = np.empty_like(shape.nodes), np.empty_like(shape.directors)
        twists, curvatures = np.empty_like(shape.twists), np.empty_like(shape.curvatures)
        step = np.ascontiguousarray(step, dtype=np.float64)
        old = (self.node_offsets, shape.nodes, shape.directors, shape.twists, self.radii, step)
        _kernels.displace(*old, nodes, directors, twists, curvatures)
        return replace(shape, nodes=nodes, directors=directors, twists=twists, curvatures=curvatures)

    def implicit_system(self, shape: RodShape, dt: float, gravity: Vector, moving: Vector) -> FibreSystem:
        """System of implicit Euler from `shape`, given velocities (all,) of the held displacements: see `Rods.system`."""
        place, guess, tensions = shape, np.zeros(self.size), self.tensions(shape)
        first_edges = self.node_offsets[:-1] - np.arange(len(self.radii))
        counts = 4 * np.diff(self.node_offsets) - 1
        active = np.ones(len(self.radii), dtype=np.bool_)
        no_blocks = np.empty(0)
        for _ in range(self.iterations - 1):
            change = moving - guess
            change[self.free] += self._linear(
                shape, place, tensions, guess, moving, dt, gravity, no_blocks, active
            )
            change[~np.repeat(active, counts)] = 0.0
            across = np.linalg.norm(self._edges(change[self.is_node].reshape(-1, 3)), axis=1)
            turns = np.maximum.reduceat(across * dt / self.rest_lengths, first_edges)
            guess = guess + np.repeat(_LARGEST_TURN / np.maximum(turns, _LARGEST_TURN), counts) * change
            after = self.displaced(shape, dt * guess)
            moved = active[self._edge_fibre]
            tensions, place = np.where(moved, self.tensions_to(place, after), tensions), after
            active = active & (turns > _SETTLED)
            if not np.any(active):
                break
        blocks = np.empty(int(self._block_offsets[-1]))
        forces = self._linear(shape, place, tensions, guess, moving, dt, gravity, blocks)
        return FibreSystem(blocks, self._block_offsets, forces)

    def still_system(self, shape: RodShape, tensions: Vector, dt: float, gravity: Vector) -> FibreSystem:
        """System of a step from rest, ends still, linearised where the fibres are; edges stiff across by `tensions` (q,)."""
        none, blocks = np.zeros(self.size), np.empty(int(self._block_offsets[-1]))
        forces = self._linear(shape, shape, tensions, none, none, dt, gravity, blocks)
        return FibreSystem(blocks, self._block_offsets, forces)

    def _linear(
        self, shape: RodShape, place: RodShape, tensions: Vector, guess: Vector, moving: Vector, dt: float,
        gravity: Vector, blocks: Vector, active: NDArray[np.bool_] | None = None,
    ) -> Vector:  # fmt: skip
        """Right-hand side (m,) of the step from `shape` linearised at `place` = shape + dt * guess, filling `blocks`.

        With empty `blocks` the velocities (m,) that solve it, those of `active` fibres; others get what they have in `guess`.
        """
        diagonal = self.masses * (1.0 / dt + self.damping.mass) + self._air
        loads = self.masses * shape.motion / dt
        loads[self.is_node] += (self.masses[self.is_node].reshape(-1, 3) * gravity).ravel()
        band, factor = np.empty((self.size, _kernels.BAND)), np.empty((self.size, _kernels.BAND))
        margin, forces = SMALLEST_SHARE_OF_MASS * self.masses / dt, guess[self.free]
        every = np.ones(len(self.radii), dtype=np.bool_) if active is None else active
        _kernels.step_systems(
            self._fibres(place, tensions), dt, self.damping.internal, self._held, diagonal, margin, guess, moving, loads,
            band, factor, self.offsets, self._block_offsets, forces, blocks, blocks.size == 0, every,
        )  # fmt: skip
        return forces

    def tensions_to(self, before: RodShape, after: RodShape) -> Vector:
        """(q,) tensions [N] after a motion, lengths taken to first order from `before`: those of the linear system.

        An edge that turns grows longer to second order. The next iteration takes this back; as a tension it would make the
        edge far too stiff across.
        """
        edges = self._edges(before.nodes)
        lengths = np.sum(edges * self._edges(after.nodes), axis=1) / np.linalg.norm(edges, axis=1)
        return np.asarray(
            self.section.stretching[self._edge_fibre] * (lengths / self.rest_lengths - 1.0), dtype=np.float64
        )

    def _edges(self, points: Vector) -> Vector:
        """(q, 3) differences along edges."""
        first = np.arange(len(self._edge_fibre)) + self._edge_fibre
        difference: Vector = points[first + 1] - points[first]
        return difference

    def _fibres(self, shape: RodShape, tensions: Vector) -> _kernels.Fibres:
        """The fibres as kernels read them."""
        now = (self.node_offsets, shape.nodes, shape.directors, shape.twists, tensions)
        natural = (self.natural.curvatures, self.natural.twists)
        return _kernels.Fibres(*now, self.rest_lengths, self.shares, *natural, self._stiffness, self.radii)
