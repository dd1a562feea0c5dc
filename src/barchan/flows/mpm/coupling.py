"""Rigid bodies in the matter: contacts on their boundaries, the room they take, particles kept out (seed B, 7.4.1).

The boundary of each body is sampled by points finer than the grid. A traction lives on the grid nodes around these points;
forces act where the points are, on the matter through its shape functions and on the body, so that what one gains the other
loses: linear and angular momentum are conserved to round-off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Surface,
    contact_columns,
    generalised_masses,
    is_driven,
    moved,
    predicted_velocities,
)
from barchan.bodies.rigid.rotations import matrix
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.body_walls import contacts_with_walls
from barchan.flows.mpm.contacts import Contacts
from barchan.flows.mpm.velocity import VelocityField
from barchan.flows.mpm.walls import Walls
from barchan.linalg.frames import contact_frames
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]

# Points of a boundary to a cell edge.
FINENESS = 2.5
# Where the normals around a node differ more than this (length of their mean), it has a contact for each direction they face.
COHERENCE = 0.8
# Functions with this share of the largest mass around a boundary point count half as much as their value there.
NEGLIGIBLE_MASS = 0.3
# Names of the contacts of functions inside bodies lie below those of patches, and above those of bodies with walls.
FIRST_INSIDE = -(2**61)
SMALLEST_AREA = 1e-4  # of a face of a cell
# Points of a boundary that lies in a face of the grid belong to the cell outside of the body (in cells).
OUTWARDS = 1e-6


@dataclass(frozen=True, eq=False)
class Coupling:
    """The bodies of a simulation with the sampled boundaries, made once.

    grid : of the matter.  bodies : free, fixed and prescribed ones, in the order of the states.
    """

    grid: RegularGrid
    bodies: Sequence[Body]
    surfaces: tuple[Surface, ...] = field(init=False)

    def __post_init__(self) -> None:
        spacing = float(np.min(self.grid.spacing)) / FINENESS
        reach = np.max(np.abs(np.stack([self.grid.origin, self.grid.upper])), axis=0)
        surfaces = []
        for body in self.bodies:
            if body.shape.bounded:
                surfaces.append(body.shape.surface(spacing))
                continue
            away = float(np.linalg.norm(np.asarray(body.position))) + float(np.linalg.norm(reach))
            surfaces.append(
                body.shape.surface(spacing, -np.full(len(reach), away), np.full(len(reach), away))
            )
        object.__setattr__(self, "surfaces", tuple(surfaces))

    @property
    def free(self) -> list[int]:
        """Numbers of the bodies whose velocity is an unknown."""
        return [number for number, body in enumerate(self.bodies) if not is_driven(body)]

    def contacts(
        self, states: BodyStates, velocity: VelocityField, walls: Walls, dt: float, time: float
    ) -> list[Contacts]:
        """The contacts of each body with the matter, and of free ones with the walls."""
        order = {number: place for place, number in enumerate(self.free)}
        found = []
        for number in range(len(self.bodies)):
            contacts = self._of_body(number, states, velocity, dt, time, order.get(number, -1))
            if contacts is not None:
                found.append(contacts)
            inside = self._inside(number, states, velocity, dt, time, order.get(number, -1))
            if inside is not None:
                found.append(inside)
            if number in order:
                row = states.row(number)
                points = row.position + self.surfaces[number].points @ matrix(row.rotation).T
                found += contacts_with_walls(
                    self.grid, walls, self.bodies[number], row, points, number, order[number], dt
                )
        return found

    def distances(self, number: int, states: BodyStates, points: Vector) -> tuple[Vector, Vector]:
        """Signed distances (n,) of world points (n, d) to a body, and the points in its frame."""
        rotation = matrix(states.rotations[number])
        local = (points - states.positions[number]) @ rotation
        return self.bodies[number].shape.signed_distance(local), local

    def free_shares(self, states: BodyStates, occupied: NDArray[np.int64]) -> Vector:
        """(C, 2^d) share of each half-cell of the occupied cells outside of all bodies, from the distance of its middle."""
        grid, d = self.grid, self.grid.dimension
        shares = np.ones((len(occupied), 2**d))
        index = np.stack(np.unravel_index(occupied, tuple(grid.cells)), axis=-1)
        halves = np.array(list(product((0.25, 0.75), repeat=d)))
        width = 0.5 * float(np.mean(grid.spacing))
        for number in range(len(self.bodies)):
            near = np.flatnonzero(self.near(number, states, occupied, 0.0))
            middles = grid.origin + grid.spacing * (index[near][:, None, :] + halves)
            distance, _ = self.distances(number, states, middles.reshape(-1, d))
            outside = np.clip(0.5 + distance / width, 0.0, 1.0).reshape(-1, 2**d)
            shares[near] = np.minimum(shares[near], outside)
        return shares

    def near(
        self, number: int, states: BodyStates, cells: NDArray[np.int64], margin: float
    ) -> NDArray[np.bool_]:
        """(C,) whether each cell comes within `margin` [m] of a body or lies in it."""
        grid = self.grid
        index = np.stack(np.unravel_index(cells, tuple(grid.cells)), axis=-1)
        distance, _ = self.distances(number, states, grid.origin + grid.spacing * (index + 0.5))
        return np.asarray(distance <= 0.5 * float(np.linalg.norm(grid.spacing)) + margin)

    def kept_out(self, states: BodyStates, positions: Vector) -> Vector:
        """Positions (P, d), those inside a body moved along its normal to its boundary, within the box."""
        grid, positions = self.grid, positions.copy()
        cells = np.clip(((positions - grid.origin) / grid.spacing).astype(np.int64), 0, grid.cells - 1)
        flat = np.ravel_multi_index(tuple(cells.T), tuple(grid.cells))
        held = np.flatnonzero(np.bincount(flat, minlength=grid.cell_count))
        for number, body in enumerate(self.bodies):
            close = np.zeros(grid.cell_count, dtype=np.bool_)
            close[held[self.near(number, states, held, 0.0)]] = True
            suspects = np.flatnonzero(close[flat])
            if len(suspects) == 0:
                continue
            distance, local = self.distances(number, states, positions[suspects])
            inside = distance < 0.0
            if np.any(inside):
                out = body.shape.normals(local[inside]) @ matrix(states.rotations[number]).T
                moved = suspects[inside]
                positions[moved] -= distance[inside][:, None] * out
                clearance = 1e-9 * grid.spacing
                positions[moved] = np.clip(positions[moved], grid.origin + clearance, grid.upper - clearance)
        return positions

    def moved(self, states: BodyStates, blocks: Vector, dt: float, time: float) -> BodyStates:
        """The bodies after `dt` seconds; `blocks` (f, 2, d) are the generalised velocities of the free ones."""
        order = {number: place for place, number in enumerate(self.free)}
        rows = []
        for number, body in enumerate(self.bodies):
            row = states.row(number)
            own = (
                blocks[order[number]]
                if number in order
                else predicted_velocities(body, row, np.zeros(self.grid.dimension), dt, time)
            )
            rows.append(moved(body, row, own, dt, time))
        return BodyStates.of(rows, self.grid.dimension)

    def _of_body(
        self, number: int, states: BodyStates, velocity: VelocityField, dt: float, time: float, place: int
    ) -> Contacts | None:
        body, grid, d = self.bodies[number], self.grid, self.grid.dimension
        rotation = matrix(states.rotations[number])
        normals = self.surfaces[number].normals @ rotation.T
        points = states.positions[number] + self.surfaces[number].points @ rotation.T
        points += OUTWARDS * float(np.min(grid.spacing)) * normals
        hats = VelocityBasis(grid, "Q1")
        inside = np.flatnonzero(grid.contains(points))
        cells = hats.evaluate(points[inside]).cells
        touched = velocity.matter.active.cell_numbers[cells] >= 0
        chosen = inside[touched]
        if len(chosen) == 0:
            return None
        points, normals = points[chosen], normals[chosen]
        patches, keys = _patches(
            hats, points, normals, self.surfaces[number].areas[chosen], number, len(self.bodies)
        )
        rows, shares, points = _matter_at(velocity, points)
        there = sp.csr_array(
            (shares.reshape(-1), rows.reshape(-1), np.arange(len(points) + 1) * rows.shape[1]),
            shape=(len(points), len(velocity.ids)),
        )
        weights = sp.csr_array(patches @ there)
        weights.sort_indices()
        areas = np.asarray(patches.sum(axis=1)).reshape(-1)
        mean = patches @ normals
        lengths = np.linalg.norm(mean, axis=1)
        moving = self._boundary_velocities(number, states, points, dt, time, place)
        columns = (patches @ moving[0].reshape(len(points), -1)).reshape(len(keys), 2, d, d)
        driven = patches @ moving[1]
        return Contacts(
            keys, areas, contact_frames(mean / lengths[:, None]), np.full(len(keys), float(body.friction)),
            weights.indptr.astype(np.int32), weights.indices.astype(np.int32), weights.data,
            np.full(len(keys), place), columns, driven,
        )  # fmt: skip

    def _inside(
        self, number: int, states: BodyStates, velocity: VelocityField, dt: float, time: float, place: int
    ) -> Contacts | None:
        """Contacts of the functions whose places lie in the body: they may not move deeper into it.

        Falling freely, they would let the cells that the boundary cuts dilate without end, and matter above pack as much.
        """
        body, d = self.bodies[number], self.grid.dimension
        depth, local = self.distances(number, states, velocity.places)
        deep = np.flatnonzero(depth < 0.0)
        if len(deep) == 0:
            return None
        count, points = len(deep), velocity.places[deep]
        normals = body.shape.normals(local[deep]) @ matrix(states.rotations[number]).T
        area = float(np.prod(self.grid.spacing)) ** ((d - 1.0) / d)
        columns, driven = self._boundary_velocities(number, states, points, dt, time, place)
        names = FIRST_INSIDE - (velocity.ids[deep] * len(self.bodies) + number)
        return Contacts(
            names, np.full(count, area), contact_frames(normals), np.full(count, float(body.friction)),
            np.arange(count + 1, dtype=np.int32), deep.astype(np.int32), np.full(count, area),
            np.full(count, place), area * columns, area * driven,
        )  # fmt: skip

    def _boundary_velocities(
        self, number: int, states: BodyStates, points: Vector, dt: float, time: float, place: int
    ) -> tuple[Vector, Vector]:
        """How a body moves at points (m, d): (m, 2, d, d) by its unknowns if it is free, and (m, d) as given if it is not."""
        body, d = self.bodies[number], self.grid.dimension
        moving = contact_columns(body, states.row(number), points)
        if place < 0:
            blocks = predicted_velocities(body, states.row(number), np.zeros(d), dt, time)
            return np.zeros_like(moving), np.einsum("pbij,bj->pi", moving, blocks)
        held = np.isinf(generalised_masses(body, states.row(number)))
        return np.where(held[None, :, None, :], 0.0, moving), np.zeros((len(points), d))


def _matter_at(velocity: VelocityField, points: Vector) -> tuple[NDArray[np.int32], Vector, Vector]:
    """Velocity numbers (m, j), shares (m, j) and centres (m, d) [m] of the matter that touches boundary points (m, d).

    A function counts by its value, but those with next to no mass do not: one that lies almost wholly in the body would give
    way for all the others. The mean of an affine field is its value at the centre of the shares: there the body is taken too.
    """
    shapes = velocity.basis.evaluate(points)
    rows = velocity.numbers[velocity.basis.of_cells(shapes.cells)]
    masses = velocity.masses[rows]
    shares = shapes.weights * masses / (masses + NEGLIGIBLE_MASS * np.max(masses, axis=1, keepdims=True))
    shares /= np.sum(shares, axis=1, keepdims=True)
    return rows, shares, np.einsum("mj,mjd->md", shares, velocity.places[rows])


def _patches(
    hats: VelocityBasis, points: Vector, normals: Vector, areas: Vector, number: int, bodies: int
) -> tuple[sp.csr_array, NDArray[np.int64]]:
    """(k, m) areas with which the boundary points count for each traction, and the lasting names (k,) of the tractions.

    A node has one traction, or one for each of the 2 d directions where the normals around it differ much.
    """
    d = points.shape[1]
    shapes = hats.evaluate(points)
    nodes = hats.of_cells(shapes.cells)
    shares = shapes.weights * areas[:, None]
    ids, flat = np.unique(nodes, return_inverse=True)
    flat = flat.reshape(nodes.shape)
    total = np.bincount(flat.reshape(-1), shares.reshape(-1), minlength=len(ids))
    mean = np.stack(
        [
            np.bincount(flat.reshape(-1), (shares * normals[:, k : k + 1]).reshape(-1), minlength=len(ids))
            for k in range(d)
        ],
        axis=1,
    )
    rough = np.linalg.norm(mean, axis=1) < COHERENCE * total
    axis = np.argmax(np.abs(normals), axis=1)
    facing = 1 + 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0)
    group = np.where(rough[flat], facing[:, None], 0)
    names = (ids[flat] * (2 * d + 1) + group) * bodies + number
    keys, rows = np.unique(names, return_inverse=True)
    columns = np.broadcast_to(np.arange(len(points))[:, None], nodes.shape)
    patches = sp.csr_array(
        (shares.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(len(keys), len(points))
    )
    sums = np.asarray(patches.sum(axis=1)).reshape(-1)
    large = sums > SMALLEST_AREA * float(np.prod(hats.grid.spacing)) / float(np.max(hats.grid.spacing))
    # Names of walls are not negative.
    return sp.csr_array(patches[large]), -1 - keys[large]
