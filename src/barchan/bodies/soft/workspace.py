"""The arrays that the kernels of soft spheres work on: three components in any dimension, made from a state and back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining.interactions import WALL, Interactions
from barchan.bodies.rigid import BodyStates
from barchan.bodies.soft import _contact_kernels as contacts
from barchan.bodies.soft import _neighbour_kernels, _step_kernels
from barchan.bodies.soft.cell import CellState, cell_rows, drive_of, wrap
from barchan.bodies.soft.neighbours import Neighbours, check_cell, find_neighbours
from barchan.bodies.soft.state import SoftState
from barchan.bodies.soft.walls import wall_rows
from barchan.errors import InputError

if TYPE_CHECKING:
    from barchan.bodies.soft.model import SoftSpheres

Vector = NDArray[np.float64]
PARALLEL_GRAINS = (
    20_000  # below this, waking other threads costs more than it saves, most of all on busy cores
)
_DEEPEST_START = 0.5  # of the smaller radius


@contextmanager
def threads_for(grains: int) -> Iterator[None]:
    """One thread for few grains; the results do not depend on it."""
    before = numba.get_num_threads()
    if grains < PARALLEL_GRAINS:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


class Workspace:
    """Mutable arrays of one call; x, v, w (n, 3), rotations (n, 1 or 4), a, b (n, 3) accelerations."""

    def __init__(self, model: SoftSpheres, bodies: BodyStates, time: float, cell: CellState) -> None:
        d, n = model.dimension, len(bodies)
        self.model, self.time = model, time
        self.x, self.v, self.w = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        self.x[:, :d], self.v[:, :d] = bodies.positions, bodies.velocities
        self.w[:, 3 - bodies.spins.shape[1] :] = bodies.spins
        self.rotations = np.array(bodies.rotations, dtype=np.float64)
        self.a, self.b = np.zeros((n, 3)), np.zeros((n, 3))
        inverse = np.where(model.held, 0.0, 1.0)
        columns = (model.radii, inverse / model.masses, inverse / model.moments, model.friction)
        self.grains = np.ascontiguousarray(np.stack(columns, axis=1))
        self.gravity = np.zeros(3)
        self.gravity[:d] = model.gravity
        self.law = model.contact.numbers()
        self.walls = wall_rows(model.walls, d)
        self.wall_memory = np.zeros((n, len(self.walls), contacts.MEMORY))
        self.wall_out = np.zeros((n, len(self.walls), 8))
        self.cell = cell_rows(model.cell, cell, d)
        self.drive = drive_of(model.cell, cell, d)
        self.dissipated = 0.0
        self.reach = 2.0 * float(np.max(model.radii))
        self.neighbours: Neighbours
        self.memory: Vector
        self.out: Vector

    @classmethod
    def starting(cls, model: SoftSpheres, bodies: BodyStates, time: float) -> Workspace:
        """Fresh contacts, and the accelerations they give."""
        height = model.cell.lengths[-1] if model.cell is not None else 0.0
        work = cls(model, bodies, time, CellState(height))
        if model.cell is not None:
            lengths = np.diag(work.cell[:, :3])
            check_cell(
                lengths, height, model.cell.shear_rate != 0.0, work.reach + model.skin, model.dimension
            )
        with threads_for(len(bodies)):
            work.list_pairs(np.empty((0, 2), dtype=np.int64), np.zeros((0, contacts.MEMORY)))
            work._evaluate()
        work._refuse(_DEEPEST_START, "positions")
        if work.drive[5] > 0.0:
            work.drive[6] = _step_kernels.normal_stress(
                model.dimension - 1, work.v, work.grains, work.out, work._volume()
            )
        return work

    @classmethod
    def of(cls, model: SoftSpheres, state: SoftState) -> Workspace:
        """Working copies of a state."""
        if len(state) != len(model) or state.wall_memory.shape[1] != len(model.walls):
            raise InputError(
                "state",
                (len(state), state.wall_memory.shape[1]),
                f"{len(model)} grains, {len(model.walls)} walls",
            )
        work = cls(model, state.bodies, state.time, state.cell)
        work.a, work.b = state.accelerations[:, :3].copy(), state.accelerations[:, 3:].copy()
        work.wall_memory = state.wall_memory.copy()
        work.dissipated = state.dissipated
        with threads_for(len(model)):
            work.list_pairs(state.pairs, state.memory)
        return work

    def list_pairs(self, pairs: NDArray[np.int64], memory: Vector) -> None:
        """New neighbour list; contacts keep what they remember in `memory` (k, 7) of `pairs` (k, 2), sorted."""
        n = len(self.x)
        wrap(self.x, self.v, self.cell)
        self.neighbours = find_neighbours(
            self.x, self.grains, self.model.skin, self.cell, self.model.dimension
        )
        rows = np.zeros(n + 1, dtype=np.int64)
        np.cumsum(np.bincount(pairs[:, 0], minlength=n), out=rows[1:])
        self.memory = np.zeros((len(self.neighbours.pairs), contacts.MEMORY))
        self.out = np.zeros((len(self.memory), contacts.OUT))
        _neighbour_kernels.carry_memory(
            self.neighbours.rows, self.neighbours.pairs, pairs, rows, memory, self.memory
        )

    def advance(self, dt: float, steps: int) -> None:
        """Take the steps, with a new list of neighbours whenever the old one is used up."""
        left = steps
        with threads_for(len(self.x)):
            while left > 0:
                taken = self._run(dt, left)
                left -= taken
                self.time += taken * dt
                self.dissipated += float(np.sum(self.out[:, 7]) + np.sum(self.wall_out[:, :, 7]))
                self.wall_out[:, :, 7] = 0.0
                self._refuse(1.0, "dt", dt)
                if left > 0:
                    self.list_pairs(*self._touching())

    def state(self) -> SoftState:
        """The arrays as a state."""
        d, last = self.model.dimension, self.model.dimension - 1
        wrap(self.x, self.v, self.cell)
        spins = self.w[:, 2:] if d == 2 else self.w
        bodies = BodyStates(
            self.x[:, :d].copy(), self.rotations.copy(), self.v[:, :d].copy(), np.ascontiguousarray(spins)
        )
        cell = CellState(*(float(v) for v in (
            self.cell[last, last], self.cell[last, 3 + last], self.cell[last, 0], self.drive[6]
        )))  # fmt: skip
        accelerations = np.concatenate([self.a, self.b], axis=1)
        return SoftState(
            bodies,
            self.time,
            cell,
            accelerations,
            *self._touching(),
            self.wall_memory.copy(),
            self.dissipated,
        )

    def interactions(self) -> Interactions:
        """Forces of the present state, without changing it."""
        memory, wall_memory = self.memory.copy(), self.wall_memory.copy()
        a, b, v, w = self.a.copy(), self.b.copy(), self.v.copy(), self.w.copy()
        with threads_for(len(self.x)):
            self._evaluate()
        self.memory, self.wall_memory, self.a, self.b, self.v, self.w = memory, wall_memory, a, b, v, w
        d = self.model.dimension
        touching = np.flatnonzero(self.out[:, 6] > 0.0)
        first, second = self.neighbours.pairs[touching].T
        row = self.out[touching]
        swap = self.grains[first, 1] == 0.0
        sign = np.where(swap, -1.0, 1.0)[:, None]
        first, second = np.where(swap, second, first), np.where(swap, first, second)
        forces, branches = sign * row[:, :d], sign * row[:, 8 : 8 + d]
        normals = branches / np.linalg.norm(branches, axis=1)[:, None]
        arms = (self.model.radii[first] - 0.5 * row[:, 6])[:, None] * normals
        points = self.x[first, :d] - arms
        held = self.grains[second, 1] == 0.0
        branches = np.where(held[:, None], arms, branches)
        grain, wall = np.nonzero(self.wall_out[:, :, 6] > 0.0)
        row = self.wall_out[grain, wall]
        wall_normals = self.walls[wall, :d]
        wall_arms = (self.model.radii[grain] - 0.5 * row[:, 6])[:, None] * wall_normals
        return Interactions(
            np.concatenate([first, grain]),
            np.concatenate([np.where(held, WALL, second), np.full(len(grain), WALL)]),
            np.concatenate([forces, row[:, :d]]),
            np.concatenate([branches, wall_arms]),
            np.concatenate([normals, wall_normals]),
            np.concatenate([points, self.x[grain, :d] - wall_arms]),
        )

    def _touching(self) -> tuple[NDArray[np.int64], Vector]:
        touching = self.memory[:, 6] > 0.0
        return self.neighbours.pairs[touching], self.memory[touching]

    def _volume(self) -> float:
        lengths = np.diag(self.cell[:, :3])
        return float(np.prod(lengths[lengths > 0.0]))

    def _evaluate(self) -> None:
        """Forces and accelerations at the present places and velocities."""
        near = self.neighbours
        rolling = self.model.rolling_friction
        contacts.pair_forces(
            near.pairs, near.shifts, self.x, self.v, self.w, self.grains, self.cell, self.law, rolling, 0.0,
            self.memory, self.out,
        )  # fmt: skip
        _step_kernels.kick(
            self.x, self.v, self.w, self.a, self.b, self.grains, self.gravity, near.rows, near.second,
            near.second_rows, self.out, self.walls, self.time, self.law, rolling, 0.0,
            self.wall_memory, self.wall_out,
        )  # fmt: skip

    def _run(self, dt: float, steps: int) -> int:
        near, model = self.neighbours, self.model
        return int(
            _step_kernels.run(
                steps, dt, self.time, self.x, self.v, self.w, self.rotations, self.a, self.b, self.grains,
                self.gravity, self.cell, self.drive, self.law, model.rolling_friction, model.skin, self.reach,
                near.pairs, near.shifts, near.rows, near.second, near.second_rows, self.memory, self.out,
                self.walls, self.wall_memory, self.wall_out,
            )
        )  # fmt: skip

    def _refuse(self, share: float, field: str, value: float | str = "overlapping") -> None:
        """InputError when a pair or a grain and a wall overlap by more than `share` of the smaller radius."""
        if not (np.all(np.isfinite(self.x)) and np.all(np.isfinite(self.v))):
            raise InputError(field, value, "such that the motion stays finite: take shorter steps")
        radii = self.model.radii
        if len(self.out):
            pairs = self.neighbours.pairs
            depth = self.out[:, 6] / np.minimum(radii[pairs[:, 0]], radii[pairs[:, 1]])
            worst = int(np.argmax(depth))
            if depth[worst] > share:
                i, j = pairs[worst]
                found = f"grains {i} and {j} overlap by {self.out[worst, 6]:.3g} m"
                raise InputError(field, value, f"such that no grain enters another: {found}")
        if self.wall_out.size:
            depth = self.wall_out[:, :, 6] / radii[:, None]
            grain, wall = np.unravel_index(int(np.argmax(depth)), depth.shape)
            if depth[grain, wall] > share:
                found = f"grain {grain} is {self.wall_out[grain, wall, 6]:.3g} m deep in wall {wall}"
                raise InputError(field, value, f"such that no grain enters a wall: {found}")
