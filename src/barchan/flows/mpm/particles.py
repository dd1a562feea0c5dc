"""What a step does to the particles: velocities, frames, orientations, cohesion and places (seed B, 7.3.2, 7.3.5, 7.4.2)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError
from barchan.flows.mpm.frames import advected_frames, bounded_frames, initial_frames
from barchan.flows.mpm.orientation import decayed_cohesion, evolved_orientations, isotropic
from barchan.flows.mpm.ownership import carried_grains, taken, with_grains, with_heirs
from barchan.flows.mpm.resampling import resample
from barchan.flows.mpm.setting import Setting
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stresses import StressRows
from barchan.flows.mpm.velocity import VelocityField
from barchan.flows.mpm.walls import left_through
from barchan.spaces import sort_particles

Vector = NDArray[np.float64]

# So many particles are put in the order of their cells every so many steps: scattered memory triples the cost of transfers.
REORDERED, REORDER_EVERY = 50_000, 20


def started(setting: Setting, state: State) -> State:
    """A first state completed by the particle fields that this setting needs, and the bodies at their start.

    Frames that are not given are cubes of the particles' space V / phi_max, orientations isotropic, cohesion whole.
    Raises InputError when several materials are given and the particles do not say which is theirs.
    """
    count, d, options, materials = state.particle_count, state.dimension, setting.options, setting.materials
    new: dict[str, Any] = {}
    if _needs_frames(setting) and not len(state.frames):
        edges = (state.volumes / materials[0].max_volume_fraction) ** (1.0 / d)
        new["frames"] = initial_frames(np.repeat(edges[:, None], d, axis=1))
    if not _needs_frames(setting) and len(state.frames):
        new["frames"] = np.zeros((0, d, d))
    if any(material.cohesion_decay > 0.0 for material in materials) and not len(state.cohesions):
        new["cohesions"] = np.ones(count)
    if materials[0].anisotropy > 0.0 and not len(state.orientations):
        new["orientations"] = isotropic(count, d)
    if (options.warm_start == "particles" or options.stress == "particles") and not len(
        state.particle_stresses
    ):
        new["particle_stresses"] = np.zeros((count, d * (d + 1) // 2))
    if len(materials) > 1:
        if not len(state.materials) or np.any((state.materials < 0) | (state.materials >= len(materials))):
            raise InputError(
                "state.materials",
                "missing or out of range",
                f"a number below {len(materials)} for each particle",
            )
    elif len(state.materials):
        new["materials"] = state.materials[:0]
    if setting.bodies and len(state.bodies.positions) == 0:
        new["bodies"] = BodyStates.at_start(setting.bodies)
    if new:
        state = replace(state, **new)
    return with_grains(setting, state)


def _needs_frames(setting: Setting) -> bool:
    options = setting.options
    return options.stress == "particles" or options.resampling is not None or options.grains > 0


def follow_flow(
    setting: Setting,
    state: State,
    field: VelocityField,
    rows: StressRows,
    velocities: Vector,
    shift: Vector | None,
    dt: float,
    resting: bool,
    stresses: Vector,
    bodies: BodyStates,
) -> tuple[State, int]:
    """The particles after `dt` seconds in the field `velocities` (n, d), with what they carry, and the substeps of the move.

    field, rows : the velocity functions and stresses of the step.
    resting : whether the step is a PIC step because it began nearly at rest.
    stresses : (q, s) [Pa] of the rows, left on the particles where these carry stresses.
    bodies : where the rigid bodies are after the step; particles do not stay inside them.

    Raises InputError when the last particle has left through an open face.
    """
    speeds, slopes = field.to_particles(velocities)
    places, substeps = field.moved(velocities, speeds, dt, setting.options.cfl, shift)
    if setting.options.transfer == "flip" and state.step > 0 and not resting:
        change, _ = field.to_particles(velocities - field.velocities)
        share = setting.options.flip_share
        speeds = share * (state.velocities + change) + (1.0 - share) * speeds
    affine = field.affine(velocities, slopes)
    new: dict[str, Any] = {"positions": places, "velocities": speeds, "affine": affine}
    if len(state.particle_stresses):
        new["particle_stresses"] = rows.at_particles(stresses)
    new |= _carried(setting, state, slopes, dt)
    after = replace(state, time=state.time + dt, step=state.step + 1, **new)
    after = carried_grains(setting, state, after, slopes, dt)
    out = left_through(setting.grid, setting.walls, after.positions)
    if np.any(out):
        if np.all(out):
            raise InputError("state.positions", "every particle has left the box", "at least one inside it")
        after = taken(after, np.flatnonzero(~out))
    after = _resampled(setting, after)
    if setting.coupling is not None:
        places = setting.coupling.kept_out(bodies, after.positions.copy())
        grains = after.grain_positions
        if len(grains):
            grains = grains + (places - after.positions)[after.grain_owners]
        after = replace(after, positions=places, grain_positions=grains, bodies=bodies)
    if after.particle_count >= REORDERED and after.step % REORDER_EVERY == 0:
        after = taken(after, sort_particles(setting.grid, after.positions).order)
    return after, substeps


def _carried(setting: Setting, state: State, slopes: Vector, dt: float) -> dict[str, Any]:
    """Frames, orientations and cohesion in the velocity gradients `slopes` (P, d, d)."""
    new: dict[str, Any] = {}
    if len(state.frames):
        edge = float(np.max(setting.grid.spacing))
        new["frames"] = bounded_frames(advected_frames(state.frames, slopes, dt), 1e-3 * edge, 4.0 * edge)
    if len(state.orientations):
        new["orientations"] = evolved_orientations(
            state.orientations, slopes, dt, setting.materials[0].elongation, follow="normals"
        )
    if len(state.cohesions):
        rates = np.array([material.cohesion_decay for material in setting.materials])
        rate = float(rates[0]) if len(rates) == 1 else rates[state.materials]
        new["cohesions"] = decayed_cohesion(state.cohesions, slopes, rate, dt)
    return new


def _resampled(setting: Setting, state: State) -> State:
    """Particles split and merged, if the options say so."""
    options, grid = setting.options.resampling, setting.grid
    if options is None:
        return state
    cells = np.clip(((state.positions - grid.origin) / grid.spacing).astype(np.int64), 0, grid.cells - 1)
    flat = np.ravel_multi_index(tuple(cells.T), tuple(grid.cells))
    found = resample(state.particle_fields(), flat, options, grid.spacing, grid.origin, grid.upper)
    if len(found.parents) == state.particle_count and np.array_equal(
        found.parents, np.arange(state.particle_count)
    ):
        return state
    fields: dict[str, Any] = dict(found.fields)
    return with_heirs(replace(state, **fields), found)
