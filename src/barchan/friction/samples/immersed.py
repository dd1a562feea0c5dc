"""A packed column of grains under water, one time step of it: strain blocks of Q1 stresses, and a volume that is kept.

Seed B 8.3.2-8.3.3 (Eq. 8.26-8.27) on a regular grid, both velocities at all nodes of the box. In place of the mass average u_m
and the fluctuation w the unknowns are u_g = u_m + w and a q: (u_m, w) = (R u_g / (A + R) + q, A u_g / (A + R) - q) for the
inertias A, R (drag included) of a node. M stays diagonal, H moves u_g alone, and u_v = a u_g + b q is free of divergence.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from barchan.cones import Coulomb, chi
from barchan.errors import InputError
from barchan.friction.problem import Problem

GRAVITY = 9.81  # m/s^2
FLUID_DENSITY = 1000.0  # kg/m^3
GRAIN_DENSITY = 2600.0
VISCOSITY = 1e-3  # Pa s
PACKED = 0.6  # volume fraction
SMALLEST_FRACTION = 1e-3  # of nodes without grains, so that M is positive definite
EXPONENT = 4.65  # of Richardson and Zaki
PRESSURES = ("coarse", "penalised")


@dataclass(frozen=True, eq=False)
class Immersed:
    """A step of an immersed column.

    problem : n blocks at the nodes with grains (then `contacts` blocks of the floor).  cell : edge of a cell, m.
    momentum : (m,) what gravity adds in a step.  velocities : how many of the m are so (the others are slack).
    """

    problem: Problem
    cell: float
    momentum: np.ndarray
    contacts: int
    velocities: int

    def following(self, v: np.ndarray) -> Immersed:
        """The next step of the same geometry, from the velocities v (m,) of this one."""
        old = self.problem
        carried = old.M @ v
        carried[self.velocities :] = 0.0
        problem = Problem(
            M=old.M, f=carried + self.momentum, H=old.H, w=old.w, law=old.law, C=old.C, k=old.k,
            block_size=old.s, reference_force=old.reference_force,
        )  # fmt: skip
        return replace(self, problem=problem)


def immersed_column(
    cells: tuple[int, ...] = (16, 8),
    filled: tuple[int, ...] | None = None,
    mu: float = 0.4,
    *,
    diameter: float = 1e-3,
    cell: float = 0.01,
    dt: float = 2e-3,
    pressure: str = "coarse",
    floor_friction: float | None = None,
    seed: int = 0,
) -> Immersed:
    """The first step of a column at rest, at the left end of a closed box with slip walls.

    Parameters
    ----------
    cells : of the box, even numbers, the last axis upwards.  filled : those of the column (None: a quarter of the length and
        three quarters of the height).  Their filling varies by a tenth, as `seed` has it.
    mu : friction in cone coordinates.  diameter : of a grain [m], for the drag.  dt : time step [s].
    pressure : "coarse", at the nodes of cells twice as large, one of them left out; "penalised", at all nodes, with slack
        velocities whose mass is the inverse of a small compressibility (padded to whole nodes).
    floor_friction : of blocks that hold the grains at the floor in place of its slip condition; None for none.

    Raises
    ------
    InputError : cells that are odd or not two or three numbers, a column that does not fit, an unknown pressure.
    """
    filled = _checked(cells, filled, pressure)
    grid, d = _Grid(cells, cell), len(cells)
    share = np.zeros(cells)
    share[tuple(slice(0, count) for count in filled)] = 1.0
    share *= np.random.default_rng(seed).uniform(0.9, 1.0, cells)
    free = grid.free()
    free_of_grains = free.copy()
    floor = grid.floor() if floor_friction is not None else np.zeros(0, np.int64)
    free_of_grains[floor, -1] = True
    strain, rows, volume = _strains(grid, PACKED * share.ravel() * cell**d, free_of_grains)
    phi = np.clip(volume / grid.volumes(), SMALLEST_FRACTION, PACKED)
    inertia, momentum, a, b = _inertias(phi, grid.volumes(), diameter, dt, d)
    contacts = np.intersect1d(floor, rows)
    H = _with_rows(strain, _floor_blocks(d) * free_of_grains[contacts][:, None, :], contacts)
    B = grid.divergence(coarse=pressure == "coarse", free=free)
    C = sp.hstack([B @ sp.diags_array(np.repeat(a, d)), B @ sp.diags_array(np.repeat(b, d))], format="csr")
    if pressure == "penalised":
        slack = -(-C.shape[0] // d) * d
        C = sp.hstack([C, sp.eye_array(C.shape[0], slack)], format="csr")
        # A pressure p leaves the volume c p / dt: the relative compression under rho g h is 1e-3.
        stiffness = 1e3 * FLUID_DENSITY * GRAVITY * cells[-1] * cell * dt / cell**d
        inertia = np.append(inertia, np.full(slack, stiffness))
        momentum = np.append(momentum, np.zeros(slack))
        H = sp.bsr_array((H.data, H.indices, H.indptr), shape=(H.shape[0], len(inertia)))
    n = H.shape[0] // H.blocksize[0]
    friction = np.full(n, mu)
    friction[n - len(contacts) :] = 0.0 if floor_friction is None else floor_friction
    overburden = PACKED * (GRAIN_DENSITY - FLUID_DENSITY) * GRAVITY * 0.5 * filled[-1] * cell
    problem = Problem(
        M=sp.diags_array(inertia), f=momentum, H=H, w=np.zeros(H.shape[0]), law=Coulomb(friction), C=C,
        k=np.zeros(C.shape[0]), block_size=H.blocksize[0], reference_force=overburden * math.sqrt(n),
    )  # fmt: skip
    return Immersed(problem, cell, momentum, len(contacts), 2 * grid.count * d)


def _checked(cells: tuple[int, ...], filled: tuple[int, ...] | None, pressure: str) -> tuple[int, ...]:
    """The cells of the column; InputError for what `immersed_column` refuses."""
    d = len(cells)
    if d not in (2, 3) or any(count < 2 or count % 2 for count in cells):
        raise InputError("cells", cells, "two or three even numbers >= 2")
    if filled is None:
        filled = (max(1, cells[0] // 4), *cells[1:-1], max(1, 3 * cells[-1] // 4))
    if len(filled) != d or any(not 0 < some <= all_ for some, all_ in zip(filled, cells, strict=True)):
        raise InputError("filled", filled, f"{d} numbers from 1 to {cells}")
    if pressure not in PRESSURES:
        raise InputError("pressure", pressure, "one of " + ", ".join(PRESSURES))
    return filled


class _Grid:
    """Nodes of a box of cubic cells, numbered along the last axis first; corners of a cell by 0 and 1 along each axis."""

    def __init__(self, cells: tuple[int, ...], cell: float) -> None:
        self.cells, self.cell, self.d = cells, cell, len(cells)
        self.nodes = tuple(count + 1 for count in cells)
        self.count = math.prod(self.nodes)
        self.corners = np.array(list(itertools.product((0, 1), repeat=self.d)))
        points = 0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0)
        self.points = np.array(list(itertools.product(points, repeat=self.d)))
        self.places = np.stack(np.unravel_index(np.arange(math.prod(cells)), cells), axis=1)

    def of_cells(self) -> np.ndarray:
        """(cells, 2^d) nodes."""
        return self._numbers(self.places[:, None, :] + self.corners, self.nodes)

    @staticmethod
    def _numbers(places: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        return np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), shape)

    def shapes(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Multilinear functions (p, 2^d) of a cell of edge 1 and their gradients (p, 2^d, d)."""
        factors = np.where(self.corners, points[:, None, :], 1.0 - points[:, None, :])
        slopes = np.repeat(factors[:, :, None, :], self.d, axis=2)
        slopes[:, :, np.arange(self.d), np.arange(self.d)] = np.where(self.corners, 1.0, -1.0)
        return factors.prod(axis=-1), slopes.prod(axis=-1)

    def free(self) -> np.ndarray:
        """(nodes, d) components that walls leave free: all but the normal ones."""
        places = np.stack(np.unravel_index(np.arange(self.count), self.nodes), axis=1)
        return np.asarray((places > 0) & (places < np.array(self.cells)))

    def floor(self) -> np.ndarray:
        """Nodes of the floor."""
        return np.arange(self.count).reshape(self.nodes)[..., 0].ravel()

    def volumes(self) -> np.ndarray:
        """(nodes,) volumes of the nodes, m^d."""
        volumes = np.zeros(self.count)
        np.add.at(volumes, self.of_cells(), (0.5 * self.cell) ** self.d)
        return volumes

    def divergence(self, coarse: bool, free: np.ndarray) -> sp.csr_array:
        """(pressures, nodes d) integrals of q div v; the rows add up to zero, so one is left out where they are `coarse`."""
        shape = tuple(count // 2 + 1 for count in self.cells) if coarse else self.nodes
        _, slopes = self.shapes(self.points)
        weight = self.cell ** (self.d - 1) / len(self.points)
        triplets = []
        for parity in itertools.product((0, 1), repeat=self.d) if coarse else [(0,) * self.d]:
            alike = (self.places % 2 == parity).all(axis=1) if coarse else np.ones(len(self.places), bool)
            points = 0.5 * (np.array(parity) + self.points) if coarse else self.points
            local = weight * np.einsum("pi,pjc->ijc", self.shapes(points)[0], slopes)
            places = self.places[alike]
            above = self._numbers((places // 2 if coarse else places)[:, None, :] + self.corners, shape)
            column = self.of_cells()[alike][:, :, None] * self.d + np.arange(self.d)
            size = (len(places), *local.shape)
            triplets.append([
                np.broadcast_to(part, size).ravel()
                for part in (local[None], above[:, :, None, None], column[:, None])
            ])  # fmt: skip
        data, rows, columns = (np.concatenate(parts) for parts in zip(*triplets, strict=True))
        B = sp.csr_array((data, (rows, columns)), shape=(math.prod(shape), self.count * self.d))
        B = sp.csr_array(B @ sp.diags_array(free.ravel().astype(float)))
        B.eliminate_zeros()
        return sp.csr_array(B[1:]) if coarse else B


def _strains(
    grid: _Grid, matter: np.ndarray, free: np.ndarray
) -> tuple[sp.bsr_array, np.ndarray, np.ndarray]:
    """H of Q1 stresses and velocities with `matter` (cells,) m^d; the nodes of its rows, and the matter at all nodes."""
    d, filled = grid.d, np.flatnonzero(matter)
    values, slopes = grid.shapes(grid.points)
    local = np.einsum("pi,pjc->ijc", values, slopes) / (len(grid.points) * grid.cell)
    nodes = grid.of_cells()[filled]
    volume = np.zeros(grid.count)
    np.add.at(volume, nodes, matter[filled, None] / len(grid.corners))
    rows, inverse = np.unique(nodes, return_inverse=True)
    i = np.broadcast_to(inverse.reshape(nodes.shape)[:, :, None], (len(filled), *(local.shape[:2]))).ravel()
    j = np.broadcast_to(nodes[:, None, :], (len(filled), *(local.shape[:2]))).ravel()
    gradients = (matter[filled, None, None, None] * local).reshape(-1, d)
    pattern = sp.csr_array((np.ones(len(i)), (i, j)), shape=(len(rows), grid.count))
    sums = [sp.csr_array((gradients[:, c], (i, j)), shape=pattern.shape) for c in range(d)]
    for part in (pattern, *sums):
        part.sort_indices()
    g = np.stack([part.data for part in sums], axis=1)
    size = d * (d + 1) // 2
    blocks = np.einsum("sck,ek->esc", chi(np.eye(size)), g) * free[pattern.indices][:, None, :]
    shape = (len(rows) * size, 2 * grid.count * d)
    return sp.bsr_array((blocks, pattern.indices, pattern.indptr), shape=shape), rows, volume


def _floor_blocks(d: int) -> np.ndarray:
    """(s, d) normal and tangential velocities at the floor, in a block of the size of tensors."""
    block = np.zeros((d * (d + 1) // 2, d))
    block[0, -1] = 1.0
    block[1:d, : d - 1] = np.eye(d - 1)
    return block


def _with_rows(H: sp.bsr_array, blocks: np.ndarray, columns: np.ndarray) -> sp.bsr_array:
    """H with a row of one block more for each of `blocks` (k, s, d), in the block columns (k,)."""
    pointers = np.append(H.indptr, H.indptr[-1] + np.arange(1, len(columns) + 1))
    data, indices = np.concatenate([H.data, blocks]), np.append(H.indices, columns)
    return sp.bsr_array(
        (data, indices, pointers), shape=(H.shape[0] + blocks.shape[1] * len(columns), H.shape[1])
    )


def _inertias(
    phi: np.ndarray, volumes: np.ndarray, diameter: float, dt: float, d: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Diagonal of M (2 nodes d,) kg/s, momentum of gravity in a step (2 nodes d,), and a, b (nodes,) of u_v = a u_g + b q."""
    alpha = GRAIN_DENSITY / FLUID_DENSITY - 1.0
    beta = 1.0 + alpha * phi
    drag = 18.0 * VISCOSITY / diameter**2 * phi * (1.0 - phi) ** (2.0 - EXPONENT)
    A = FLUID_DENSITY * beta * volumes / dt
    R = GRAIN_DENSITY * phi * beta / (1.0 - phi) * volumes / dt + drag * (beta / (1.0 - phi)) ** 2 * volumes
    mass = np.concatenate([A * R / (A + R), A + R])
    down = np.zeros((2 * len(phi), d))
    pull = -GRAVITY * dt * A
    down[:, -1] = np.concatenate([R / (A + R) * pull, pull])
    return np.repeat(mass, d), down.ravel(), (R - alpha * phi * A) / (A + R), beta
