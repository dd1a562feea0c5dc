"""Render grains and their owners through a step: carried, handed over, dropped with particles that leave (seed B, 7.3.2)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm.grains import Grains, moved_grains, renamed_grains, sample_grains
from barchan.flows.mpm.resampling import Resampled
from barchan.flows.mpm.setting import Setting
from barchan.flows.mpm.state import State

SEED = 1


def with_grains(setting: Setting, state: State) -> State:
    """A first state with the grains that the options ask for."""
    count = setting.options.grains
    if count == 0 or len(state.grain_owners):
        return state
    grid = setting.grid
    return _with(state, sample_grains(state.positions, state.frames, count, SEED, grid.origin, grid.upper))


def carried_grains(
    setting: Setting, before: State, after: State, gradients: NDArray[np.float64], dt: float
) -> State:
    """`after` with the grains of `before` moved by the affine fields of their owners; `gradients` (P, d, d) [1/s]."""
    if not len(before.grain_owners):
        return after
    grid = setting.grid
    moved = moved_grains(
        Grains(before.grain_positions, before.grain_owners), before.positions, gradients, after.positions,
        after.frames, dt, grid.origin, grid.upper,
    )  # fmt: skip
    return _with(after, moved)


def taken(state: State, chosen: NDArray[np.int64]) -> State:
    """The state with the particles `chosen`, in that order; grains of the others are dropped."""
    particles: dict[str, Any] = {name: value[chosen] for name, value in state.particle_fields().items()}
    place = np.full(state.particle_count, -1, dtype=np.int64)
    place[chosen] = np.arange(len(chosen))
    owners = place[state.grain_owners]
    kept = owners >= 0
    return replace(state, **particles, grain_positions=state.grain_positions[kept], grain_owners=owners[kept])


def with_heirs(state: State, found: Resampled) -> State:
    """A resampled state whose grains belong to the heirs of their owners."""
    if not len(state.grain_owners):
        return state
    grains = Grains(state.grain_positions, state.grain_owners)
    return _with(state, renamed_grains(grains, found.parents, found.heirs, state.positions, state.frames))


def _with(state: State, grains: Grains) -> State:
    return replace(
        state, grain_positions=grains.positions, grain_owners=np.asarray(grains.owners, dtype=np.int64)
    )
