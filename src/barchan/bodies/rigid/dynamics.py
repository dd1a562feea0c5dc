"""Equations of motion of a rigid body in the blocks of a friction problem (seed B, Eq. 2.3-2.5, 7.24).

A body has two blocks of d generalised velocities: the velocity v of its centre of mass, and its spin along axes in which its
inertia is diagonal, w. In the plane the second block is (spin, 0), the zero being a component of unit mass that nothing moves.
The axes are those of the inertia; where spins are held, the held world axes and the axes of the inertia across them.

The angular momentum is what a step carries over: impulses add to it exactly, rotation does not change it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import inputs, rotations
from barchan.bodies.rigid.body import Body
from barchan.bodies.rigid.motions import Free, Prescribed, held_components, load_at
from barchan.bodies.rigid.states import BodyState

Vector = NDArray[np.float64]


def is_driven(body: Body) -> bool:
    """Whether the body has infinite inertia: fixed, or moved as prescribed."""
    return body.driven


def generalised_masses(body: Body, state: BodyState) -> Vector:
    """Diagonal of the mass matrix (2, d): masses [kg], then moments [kg m^2]; infinite where nothing can move the body."""
    d = body.dimension
    masses = np.full((2, d), np.inf)
    if d == 2:
        masses[1, 1] = 1.0
    if body.driven:
        return masses
    moves, spins = held_components(body.motion, d)
    masses[0, ~moves] = body.mass
    if d == 3:
        masses[1] = _spin_axes(body, state)[1]
    elif not spins[0]:
        masses[1, 0] = body.principal_moments[0]
    return masses


def generalised_velocities(body: Body, state: BodyState) -> Vector:
    """Present velocities (2, d) of a body."""
    return np.stack([state.velocity, _spin_block(body, state, state.spin)])


def predicted_velocities(body: Body, state: BodyState, gravity: Vector, dt: float, time: float) -> Vector:
    """Velocities (2, d) at the end of a step from `time` to `time + dt` if the body touched nothing.

    Gravity (d,) [m/s^2], loads and the gyroscopic torque are explicit; a prescribed body moves at its mean velocity.
    """
    d = body.dimension
    if body.driven:
        return _driven_velocities(body, state, dt, time)
    moves, _ = held_components(body.motion, d)
    force, torque = _loads(body, state, time)
    velocity = state.velocity + dt * (inputs.vector("gravity", gravity, (d,)) + force / body.mass)
    velocity[moves] = 0.0
    return np.stack([velocity, _predicted_spin(body, state, torque, dt)])


def contact_columns(body: Body, state: BodyState, points: Vector) -> Vector:
    """C (m, 2, d, d): the body's matter at world points (m, d) moves with C[:, 0] @ v + C[:, 1] @ w."""
    d = body.dimension
    arms = inputs.points(points, d) - centre_of(body, state)
    columns = np.zeros((len(arms), 2, d, d))
    columns[:, 0] = np.eye(d)
    if d == 2:
        columns[:, 1, 0, 0], columns[:, 1, 1, 0] = -arms[:, 1], arms[:, 0]
        return columns
    axes = _spin_axes(body, state)[0]
    for k in range(3):
        columns[:, 1, :, k] = np.cross(axes[:, k], arms)
    return columns


def moved(body: Body, state: BodyState, blocks: Vector, dt: float, time: float) -> BodyState:
    """The body after the step from `time` to `time + dt` whose end velocities (2, d) are `blocks`, contacts included."""
    d = body.dimension
    if isinstance(body.motion, Prescribed):
        velocities = _driven_velocities(body, state, dt, time)
        turned = body.motion.rotation_at(time + dt)
        rotation = state.rotation if turned is None else turned
        return BodyState(
            body.motion.position_at(time + dt), rotation, velocities[0], velocities[1, : body.spin_size]
        )
    if body.driven:
        return state
    rotation, spin = _turned(body, state, np.asarray(blocks)[1], dt, time)
    velocity = np.array(blocks[0], dtype=np.float64)
    if d == 3 or np.any(body.centre):
        centre = centre_of(body, state) + dt * velocity
        position = centre - rotations.matrix(rotation) @ body.centre
    else:
        position = state.position + dt * velocity
    return BodyState(position, rotation, velocity, spin)


def centre_of(body: Body, state: BodyState) -> Vector:
    """Centre of mass (d,) in the world; of a driven body the origin of its shape."""
    centre: Vector = state.position + rotations.matrix(state.rotation) @ body.centre
    return centre


def kinetic_energy(body: Body, state: BodyState) -> float:
    """m |v|^2 / 2 + spin . I spin / 2 [J]; zero for a driven body."""
    if body.driven:
        return 0.0
    turning = angular_momentum(body, state) @ state.spin
    return 0.5 * float(body.mass * state.velocity @ state.velocity + turning)


def angular_momentum(body: Body, state: BodyState) -> Vector:
    """I spin about the centre of mass (3,) or (1,) [kg m^2/s], world frame; zero for a driven body."""
    if body.driven:
        return np.zeros(body.spin_size)
    momentum: Vector = _world_inertia(body, state.rotation) @ state.spin
    return momentum


def _world_inertia(body: Body, rotation: Vector) -> Vector:
    if body.dimension == 2:
        return body.inertia
    turn = rotations.matrix(rotation)
    inertia: Vector = turn @ body.inertia @ turn.T
    return inertia


def _spin_axes(body: Body, state: BodyState) -> tuple[Vector, Vector]:
    """World axes (3, 3), in columns, of the spin block, and their moments (3,)."""
    if body.driven:
        return np.eye(3), np.full(3, np.inf)
    held = held_components(body.motion, 3)[1]
    if not np.any(held):
        return rotations.matrix(state.rotation) @ body.principal_axes, body.principal_moments
    axes, moments = np.eye(3), np.full(3, np.inf)
    free = np.flatnonzero(~held)
    if len(free):
        across = _world_inertia(body, state.rotation)[np.ix_(free, free)]
        moments[free], turn = np.linalg.eigh(across)
        axes[:, free] = np.eye(3)[:, free] @ turn
    return axes, moments


def spin_axes(body: Body, state: BodyState) -> Vector:
    """World directions (3, 3), in columns, along which the spin of a body in space is counted."""
    return _spin_axes(body, state)[0]


def _spin_block(body: Body, state: BodyState, spin: Vector) -> Vector:
    if body.dimension == 2:
        return np.array([spin[0], 0.0])
    block: Vector = _spin_axes(body, state)[0].T @ spin
    return block


def _loads(body: Body, state: BodyState, time: float) -> tuple[Vector, Vector]:
    """Force (d,) and torque (3,) or (1,) in the world frame."""
    d, s = body.dimension, body.spin_size
    force, torque = body.force, body.torque
    if isinstance(body.motion, Free):
        force = force + load_at("motion.force", body.motion.force, time, d)
        torque = torque + load_at("motion.torque", body.motion.torque, time, s)
    if d == 3 and body.torque_frame == "body":
        torque = rotations.matrix(state.rotation) @ torque
    return force, torque


def _predicted_spin(body: Body, state: BodyState, torque: Vector, dt: float) -> Vector:
    """Second block (d,) after the torque and the gyroscopic term alone: I dw/dt = torque - w x I w (seed B, Eq. 2.4)."""
    if body.dimension == 2:
        held = held_components(body.motion, 2)[1][0]
        spin = 0.0 if held else state.spin[0] + dt * torque[0] / body.principal_moments[0]
        return np.array([spin, 0.0])
    axes, moments = _spin_axes(body, state)
    change = torque - np.cross(state.spin, angular_momentum(body, state))
    block: Vector = axes.T @ state.spin + dt * (axes.T @ change) / moments
    block[np.isinf(moments)] = 0.0
    return block


def _driven_velocities(body: Body, state: BodyState, dt: float, time: float) -> Vector:
    """Mean velocities (2, d) over the step."""
    blocks = np.zeros((2, body.dimension))
    if isinstance(body.motion, Prescribed):
        blocks[0] = (body.motion.position_at(time + dt) - body.motion.position_at(time)) / dt
        before, after = body.motion.rotation_at(time), body.motion.rotation_at(time + dt)
        if before is not None and after is not None:
            spin = rotations.logarithm(rotations.product(after, rotations.inverse(before))) / dt
            blocks[1, : len(spin)] = spin
    return blocks


def _turned(body: Body, state: BodyState, block: Vector, dt: float, time: float) -> tuple[Vector, Vector]:
    """Rotation and spin at the end of the step.

    A free solid keeps its angular momentum L but for torques and contact impulses, and turns at the spin I^-1 L it has in
    the middle of the step. Where spins are held it turns at the spin of the block.
    """
    if body.dimension == 2:
        spin = np.array([block[0]])
        return rotations.turned(state.rotation, spin, dt), spin
    axes, moments = _spin_axes(body, state)
    spin = axes @ block
    if np.any(np.isinf(moments)):
        return rotations.turned(state.rotation, spin, dt), spin
    torque = _loads(body, state, time)[1]
    impulse = axes @ (moments * (block - _predicted_spin(body, state, torque, dt)))
    momentum = angular_momentum(body, state) + dt * torque + impulse
    halfway = rotations.turned(state.rotation, spin, 0.5 * dt)
    rotation = rotations.turned(state.rotation, _spin_of(body, halfway, momentum), dt)
    return rotation, _spin_of(body, rotation, momentum)


def _spin_of(body: Body, rotation: Vector, momentum: Vector) -> Vector:
    """World spin (3,) of a solid that has the angular momentum (3,)."""
    axes = rotations.matrix(rotation) @ body.principal_axes
    spin: Vector = axes @ ((axes.T @ momentum) / body.principal_moments)
    return spin
