"""The fibres and bodies of a scene from its tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.assembly import FibreAssembly
from barchan.bodies.fibres.helices import Helices, even_pieces
from barchan.bodies.fibres.model import FibreModel
from barchan.bodies.fibres.rods import Damping, Natural, Rods, Section, laid_out
from barchan.bodies.fibres.roots import MovingRoots, RootMotion, StillRoots, frames_along
from barchan.bodies.moreau import Options
from barchan.bodies.rigid import Body
from barchan.bodies.rigid.rotations import identity
from barchan.errors import InputError
from barchan.friction import methods
from barchan.friction.local import LOCAL_SOLVERS
from barchan.scenes.keyframes import rotation_of
from barchan.scenes.kinds.bodies.entries import BodyEntry
from barchan.scenes.kinds.bodies.single import build_single
from barchan.scenes.kinds.fibres.entries import FibresGroup, ObstacleEntry
from barchan.scenes.kinds.fibres.motions import Placement, carried, keyframes, root_motion, swinging
from barchan.scenes.kinds.fibres.parameters import FibresParameters

Vector = NDArray[np.float64]

_MOVING = ("motion", "amplitude", "swing", "frequency", "velocity", "spin", "start")


@dataclass(frozen=True, eq=False)
class Strands:
    """Fibres before they bend: positions of their roots and unit directions (f, 3), lengths (f,) [m]."""

    positions: Vector
    directions: Vector
    lengths: Vector


def build_model(parameters: FibresParameters) -> FibreModel[Any]:
    """The fibres. Raises InputError naming the key at fault."""
    strands = laid_strands(parameters.fibres)
    try:
        if parameters.fibres.model == "rods":
            return _rods(parameters, strands)
        return _helices(parameters, strands)
    except InputError as error:
        if "." in error.field and error.field.split(".")[0] in ("fibres", "roots"):
            raise
        key = error.field.rpartition(".")[2]
        raise InputError(f"fibres.{_KEYS.get(key, key)}", error.value, error.allowed) from None


_KEYS = {
    "lengths": "length",
    "natural": "curl",
    "curvatures": "curl",
    "internal_damping": "damping",
    "first": "radius",
}


def laid_strands(fibres: FibresGroup) -> Strands:
    """Roots on a lattice of triangles across the direction, nearest to the middle first."""
    count = 1 if fibres.arrangement == "single" else fibres.count
    rng = np.random.default_rng([fibres.seed, 1])
    frame = frames_along([fibres.direction])[0]
    step = fibres.spacing * fibres.radius
    places = step * _lattice(count)
    if fibres.jitter:
        room = 0.5 * (step - 2.0 * fibres.radius)
        angle, away = rng.uniform(0.0, 2.0 * np.pi, count), np.sqrt(rng.uniform(0.0, 1.0, count))
        places += fibres.jitter * room * away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    widest = max(float(np.max(np.linalg.norm(places, axis=1))), 1e-300)
    lean = np.tan(np.radians(fibres.splay_deg)) * places / widest
    directions = frame[:, 0] + lean @ frame[:, 1:].T
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    spread = fibres.length_spread
    lengths = fibres.length * rng.uniform(1.0 - spread, 1.0 + spread, count)
    return Strands(np.array(fibres.position) + places @ frame[:, 1:].T, directions, lengths)


def _lattice(count: int) -> Vector:
    """(count, 2) points nearest to the origin of a lattice of triangles of side 1."""
    reach = int(np.ceil(np.sqrt(count))) + 2
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    points = np.column_stack([i + 0.5 * j, 0.5 * np.sqrt(3.0) * j])
    # ties by angle, so that rounding does not choose
    distance = np.round(np.linalg.norm(points, axis=1), 9)
    order = np.lexsort((np.round(np.arctan2(points[:, 1], points[:, 0]), 9), distance))
    return np.asarray(points[order[:count]])


def _natural(fibres: FibresGroup, count: int) -> Vector:
    """(count, segments, 3) natural twist and curvatures [1/m]."""
    rng = np.random.default_rng([fibres.seed, 2])
    wanted = np.tile([fibres.curl_twist, fibres.curl, 0.0], (count, fibres.segments, 1))
    wanted[:, :, 1:] += fibres.variation * rng.standard_normal((count, fibres.segments, 2))
    return wanted


def _roots(parameters: FibresParameters, strands: Strands) -> RootMotion:
    frames = frames_along(strands.directions)
    if parameters.roots.motion == "still":
        return StillRoots(strands.positions, frames)
    return MovingRoots(strands.positions, frames, root_motion(parameters.roots))


def _rods(parameters: FibresParameters, strands: Strands) -> Rods:
    fibres, roots = parameters.fibres, _roots(parameters, strands)
    count, n = len(strands.lengths), fibres.segments
    edges = np.repeat(strands.lengths / n, n)
    offsets = (n + 1) * np.arange(count + 1)
    wanted = _natural(fibres, count)[:, 1:].reshape(-1, 3)
    inner = np.repeat(strands.lengths / n, n - 1)
    bends = np.column_stack([wanted[:, 2], -wanted[:, 1]])  # about the axes that helices curve along
    natural = Natural.of_curve(bends, wanted[:, 0], inner)
    begun = natural
    if fibres.start == "straight":
        begun = Natural(np.zeros_like(natural.curvatures), np.zeros_like(natural.twists))
    nodes, _ = laid_out(begun, edges, offsets, strands.positions, frames_along(strands.directions))
    angles = _turned(begun.twists, count, n)
    section = Section.circular(
        fibres.radius, density=fibres.density, young=fibres.young, poisson=fibres.poisson
    )
    return Rods(
        nodes, section, roots=roots, natural=natural, angles=angles, rest_lengths=edges,
        damping=Damping(internal=fibres.damping, air=fibres.air), node_offsets=offsets,
    )  # fmt: skip


def _turned(twists: Vector, count: int, segments: int) -> Vector:
    """(q,) angles of the edges: twists (k,) of inner nodes added up from the root of each fibre."""
    angles = np.zeros((count, segments))
    angles[:, 1:] = np.cumsum(twists.reshape(count, segments - 1), axis=1)
    return angles.ravel()


def _helices(parameters: FibresParameters, strands: Strands) -> Helices:
    fibres = parameters.fibres
    lengths, firsts = even_pieces(strands.lengths, pieces=fibres.segments)
    natural = _natural(fibres, len(strands.lengths)).reshape(-1, 3)
    return Helices(
        lengths, firsts, _roots(parameters, strands), radius=fibres.radius, density=fibres.density, young=fibres.young,
        poisson=fibres.poisson, natural=natural, curvatures=np.zeros_like(natural) if fibres.start == "straight" else natural,
        internal_damping=fibres.damping, air_friction=fibres.air, nodes_per_piece=fibres.nodes_per_piece,
    )  # fmt: skip


def build_obstacles(parameters: FibresParameters) -> list[Body]:
    """Bodies of [bodies], in the order of their tables. Raises InputError naming the key at fault."""
    return [_obstacle(name, entry, parameters) for name, entry in parameters.obstacles()]


def _obstacle(name: str, entry: ObstacleEntry, parameters: FibresParameters) -> Body:
    end, step = parameters.time.end, parameters.time.step
    own = {k: v for k, v in entry.model_dump(exclude_unset=True).items() if k not in _MOVING}
    own.setdefault("position", entry.position)
    if entry.motion == "driven":
        asked = {k: getattr(entry, k) for k in ("velocity", "spin", "start")}
        return build_single(name, BodyEntry(**own, **asked, motion="driven"), 3, end)
    still = build_single(name, BodyEntry(**own, motion="fixed"), 3, end)
    if entry.motion == "fixed":
        return still
    rotation = rotation_of(f"bodies.{name}.rotation", entry.rotation, 3)
    position, first = np.array(entry.position), identity(3) if rotation is None else rotation
    place: Placement
    if entry.motion == "oscillating":
        if entry.amplitude is None and entry.swing is None:
            raise InputError(
                f"bodies.{name}.swing", "missing", "given, or amplitude, for an oscillating body"
            )
        place = swinging(entry, position, first)
    else:
        place = carried(root_motion(parameters.roots), position, first)
    return Body(still.shape, name=name, friction=entry.friction, motion=keyframes(place, step, end))


def build_assembly(
    parameters: FibresParameters, model: FibreModel[Any], bodies: list[Body]
) -> FibreAssembly[Any]:
    """What steps the fibres. Raises InputError for a solver that does not exist."""
    contact, solver = parameters.contact, parameters.solver
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    if solver.local_solver and solver.local_solver not in LOCAL_SOLVERS:
        raise InputError("solver.local_solver", solver.local_solver, "one of " + ", ".join(LOCAL_SOLVERS))
    options = Options(
        tolerance=solver.tolerance, max_sweeps=solver.max_sweeps, min_sweeps=solver.min_sweeps, method=solver.method,
        recovery=contact.recovery, margin=contact.margin * parameters.fibres.radius,
    )  # fmt: skip
    chosen = {"local_solver": solver.local_solver} if solver.local_solver else {}
    return FibreAssembly(
        model, bodies, parameters.scene.gravity, contact.friction, None, options, contact.bare, contact.touching,
        contact.passes, contact.law, solver_options=chosen,
    )  # fmt: skip
