"""All bodies and joints of a scene, and the checks of how they start: overlaps, bodies that would cross in one step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact import ContactGeometry, deepest
from barchan.bodies.moreau import (
    Assembly,
    BallJoint,
    DistanceJoint,
    FixedJoint,
    Hinge,
    Joint,
    Options,
    Slider,
)
from barchan.bodies.rigid import Body, BodyStates
from barchan.errors import InputError
from barchan.friction import methods
from barchan.scenes.kinds.bodies.entries import JointEntry
from barchan.scenes.kinds.bodies.makers import made_bodies
from barchan.scenes.kinds.bodies.parameters import BodiesParameters
from barchan.scenes.kinds.bodies.single import build_single

Vector = NDArray[np.float64]


def build_bodies(parameters: BodiesParameters) -> list[Body]:
    """Bodies of [bodies], then those of [generators], in the order of their tables.

    Raises InputError naming the key of a body that cannot be, a name that two bodies have, or when nothing can move.
    """
    d, end = parameters.dimension, parameters.time.end
    bodies = [build_single(name, entry, d, end) for name, entry in parameters.single_bodies()]
    for name, maker in parameters.makers():
        bodies += made_bodies(name, maker, d, end)
    names = [body.name for body in bodies]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError("bodies", f"two bodies called {twice!r}", "names that differ")
    if all(body.driven for body in bodies):
        raise InputError("bodies", "none that is free", "one free body at least")
    return bodies


def build_joints(parameters: BodiesParameters, bodies: list[Body]) -> list[Joint]:
    """Joints of [joints]. Raises InputError naming the key at fault."""
    numbers = {body.name: number for number, body in enumerate(bodies)}
    return [_joint(f"joints.{name}", entry, numbers) for name, entry in parameters.joint_tables()]


def _joint(field: str, entry: JointEntry, numbers: dict[str, int]) -> Joint:
    for key in ("first", "second"):
        if getattr(entry, key) not in numbers:
            raise InputError(f"{field}.{key}", getattr(entry, key), "the name of a body")
    if entry.first == entry.second:
        raise InputError(f"{field}.second", entry.second, "another body than the first")
    ends = (numbers[entry.first], numbers[entry.second], tuple(entry.anchor))
    if entry.kind == "ball":
        return BallJoint(*ends)
    if entry.kind == "fixed":
        return FixedJoint(*ends)
    if entry.kind == "distance":
        if entry.second_anchor is None:
            raise InputError(f"{field}.second_anchor", "missing", "given for a distance joint, m")
        return DistanceJoint(*ends, second_anchor=tuple(entry.second_anchor))
    if entry.axis is None:
        raise InputError(f"{field}.axis", "missing", f"given for a {entry.kind}")
    if entry.kind == "slider":
        return Slider(*ends, axis=tuple(entry.axis))
    if len(entry.anchor) == 2:
        raise InputError(f"{field}.kind", entry.kind, "'ball' in 2D, where it is a pin")
    return Hinge(*ends, axis=tuple(entry.axis))


def build_assembly(parameters: BodiesParameters, bodies: list[Body]) -> Assembly:
    """What steps the bodies. Raises InputError for a solver that does not exist or pairs of unknown bodies."""
    contact, solver = parameters.contact, parameters.solver
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    options = Options(
        tolerance=solver.tolerance, max_sweeps=solver.max_sweeps, min_sweeps=solver.min_sweeps, method=solver.method,
        theta=solver.theta, restitution=contact.restitution,
        tangential_restitution=contact.tangential_restitution, rest_speed=contact.rest_speed, mixing=contact.mixing,
        pairs=pair_frictions(parameters, bodies), recovery=contact.recovery, margin=contact.margin,
    )  # fmt: skip
    return Assembly(bodies, build_joints(parameters, bodies), parameters.gravity_vector, options)


def pair_frictions(parameters: BodiesParameters, bodies: list[Body]) -> dict[tuple[str, str], float]:
    """Friction of pairs of bodies by name."""
    names = {body.name for body in bodies}
    found = {}
    for first, second, value in parameters.contact.pairs or []:
        for name in (first, second):
            if name not in names:
                raise InputError("contact.pairs", name, "names of bodies")
        found[str(first), str(second)] = float(value)
    return found


def size_of(body: Body) -> float:
    """Least extent (m) of a body along the axes of its frame; infinite for an unbounded one."""
    lower, upper = body.shape.bounds()
    return float(np.min(upper - lower))


def smallest_size(bodies: list[Body]) -> float:
    """Least extent (m) of the free bodies."""
    return min(size_of(body) for body in bodies if not body.driven)


def check_overlaps(
    parameters: BodiesParameters, bodies: list[Body], states: BodyStates, geometry: ContactGeometry
) -> None:
    """Raise InputError naming the deepest pair when bodies overlap by more than the scene allows."""
    pair, depth = deepest(geometry.detect(states, 0.0))
    allowed = parameters.contact.allowed_overlap * smallest_size(bodies)
    if pair is None or depth <= allowed:
        return
    first, second = (bodies[number].name for number in pair)
    words = f"bodies apart: {first!r} and {second!r} overlap by {depth:.3g} m, the most of all"
    key = _table_of(parameters, first)
    remedy = "; or raise contact.allowed_overlap or contact.relax"
    raise InputError(key, f"{depth:.3g} m of overlap", words + remedy)


def _table_of(parameters: BodiesParameters, name: str) -> str:
    """The table that a body comes from."""
    if name in dict(parameters.single_bodies()):
        return f"bodies.{name}"
    makers = dict(parameters.makers())
    made = next((maker for maker in makers if name == maker or name.startswith(f"{maker}_")), name)
    return f"generators.{made}"
