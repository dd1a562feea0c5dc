"""The cloth, the bodies and the assembly of a scene from its tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.cloth import (
    Cloth,
    ClothAssembly,
    ClothMaterial,
    ClothMesh,
    ClothOptions,
    Pins,
    carried_by,
    conical_skirt,
    disc,
    rectangle,
)
from barchan.bodies.rigid import Body, Fixed, Motion, Polygon, Prescribed, Revolved, Shape
from barchan.bodies.rigid.rotations import exponential, identity, matrix, product
from barchan.errors import InputError
from barchan.friction import methods
from barchan.scenes.keyframes import rotation_of
from barchan.scenes.kinds.bodies.entries import BodyEntry
from barchan.scenes.kinds.bodies.single import build_single
from barchan.scenes.kinds.cloth.entries import ClothBodyEntry, ClothGroup
from barchan.scenes.kinds.cloth.parameters import ClothParameters

Vector = NDArray[np.float64]

MESH_FORMATS = (".obj", ".ply", ".off", ".stl")
_AFTER = 4  # steps beyond the end of a run that keyframes reach
_SHAPE_KEYS = (
    "shape",
    "radius",
    "length",
    "size",
    "points",
    "normal",
    "file",
    "scale",
    "position",
    "rotation",
    "friction",
)


def build_mesh(cloth: ClothGroup) -> ClothMesh:
    """The rest shape. Raises InputError naming the key at fault."""
    try:
        if cloth.shape == "rectangle" and cloth.size is not None:
            return rectangle(cloth.size[0], cloth.size[1], cloth.spacing, cloth.pattern, cloth.seed)
        if cloth.shape == "disc" and cloth.radius is not None:
            return disc(cloth.radius, cloth.spacing, cloth.seed)
        if cloth.waist_radius is not None and cloth.hem_radius is not None and cloth.length is not None:
            return conical_skirt(cloth.waist_radius, cloth.hem_radius, cloth.length, cloth.spacing)
        return _mesh_of_file(cloth)
    except InputError as error:
        if error.field.startswith("cloth."):
            raise
        key = error.field if error.field in ClothGroup.model_fields else ("file" if cloth.file else "shape")
        raise InputError(f"cloth.{key}", error.value, error.allowed) from None


def _mesh_of_file(cloth: ClothGroup) -> ClothMesh:
    import trimesh  # half a second to load, for those who have a mesh

    path = Path(cloth.file)
    if path.suffix.lower() not in MESH_FORMATS or not path.is_file():
        raise InputError(
            "cloth.file", cloth.file, f"a file that exists and ends in {', '.join(MESH_FORMATS)}"
        )
    try:
        loaded = trimesh.load_mesh(path, process=path.suffix.lower() == ".stl")
    except (ValueError, IndexError, KeyError, TypeError, OSError) as error:
        raise InputError("cloth.file", cloth.file, f"a readable mesh ({error})") from None
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise InputError("cloth.file", cloth.file, "a mesh with triangles")
    return ClothMesh(cloth.scale * np.asarray(loaded.vertices), np.asarray(loaded.faces))


def start_of(cloth: ClothGroup, mesh: ClothMesh) -> Vector:
    """(n, 3) positions at time 0 [m]."""
    wide = mesh.vertices * np.array([cloth.widened, cloth.widened, 1.0])
    turn = exponential(np.radians(cloth.rotation))
    start = wide @ matrix(turn).T + np.array(cloth.position)
    if cloth.jitter:
        rng = np.random.default_rng([cloth.seed, 1])
        start += cloth.jitter * cloth.spacing * rng.uniform(-1.0, 1.0, start.shape)
    return np.asarray(start)


def build_cloth(parameters: ClothParameters, bodies: list[Body]) -> Cloth:
    """The cloth with its pins. Raises InputError naming the key at fault."""
    group = parameters.cloth
    mesh = build_mesh(group)
    start = start_of(group, mesh)
    vertices = pinned_vertices(parameters, mesh, start)
    pins = []
    if len(vertices):
        carrier = next((body for body in bodies if body.name == parameters.pins.body), None)
        pins = [Pins(vertices, None if carrier is None else carried_by(carrier, start[vertices]))]
    material = ClothMaterial(**parameters.material.model_dump())
    return Cloth(mesh, material, start, group.velocity, pins)


def pinned_vertices(parameters: ClothParameters, mesh: ClothMesh, start: Vector) -> NDArray[np.int64]:
    """Numbers of the vertices that [pins] holds."""
    pins, rest = parameters.pins, mesh.vertices
    near = 1e-6 * parameters.cloth.spacing
    if pins.where == "corners":
        low, high = rest.min(axis=0), rest.max(axis=0)
        at = np.any(
            [
                np.linalg.norm(rest - (x, y, 0.0), axis=1) < near
                for x in (low[0], high[0])
                for y in (low[1], high[1])
            ],
            axis=0,
        )
        return np.flatnonzero(at)
    if pins.where == "side":
        return np.flatnonzero(rest[:, 0] < rest[:, 0].min() + near)
    if pins.where == "rim":
        return mesh.boundary
    if pins.where == "waist":
        return np.flatnonzero(rest[:, 2] > rest[:, 2].max() - near)
    if pins.where == "points":
        for row in pins.points or []:
            if len(row) != 3:
                raise InputError("pins.points", row, "rows of three numbers")
        nearest = [int(np.argmin(np.linalg.norm(start - np.array(row), axis=1))) for row in pins.points or []]
        if len(set(nearest)) < len(nearest):
            raise InputError("pins.points", pins.points, "points near different vertices")
        return np.array(nearest, dtype=np.int64)
    return np.zeros(0, dtype=np.int64)


def build_obstacles(parameters: ClothParameters) -> list[Body]:
    """The bodies. Raises InputError naming the key at fault."""
    return [_body(name, entry, parameters) for name, entry in parameters.obstacles()]


def _body(name: str, entry: ClothBodyEntry, parameters: ClothParameters) -> Body:
    field = f"bodies.{name}"
    rotation = rotation_of(f"{field}.rotation", entry.rotation, 3)
    if entry.shape == "revolved":
        if entry.points is None or any(len(row) != 2 for row in entry.points):
            raise InputError(f"{field}.points", entry.points, "rows (r, z) for a revolved body, m")
        try:
            shape: Shape = Revolved(Polygon(entry.points))
        except InputError as error:
            raise InputError(f"{field}.points", error.value, error.allowed) from None
    else:
        given = {key: value for key, value in entry.model_dump().items() if key in _SHAPE_KEYS}
        shape = build_single(name, BodyEntry(**given, motion="fixed"), 3, parameters.time.end).shape
    if entry.motion == "fixed":
        if entry.stop is not None or any(
            any(getattr(entry, k)) for k in ("velocity", "spin", "amplitude", "swing")
        ):
            raise InputError(
                f"{field}.motion", entry.motion, "'moving' for a body with a velocity, spin or swing"
            )
        motion: Motion = Fixed()
        return Body(
            shape,
            name=name,
            friction=entry.friction,
            motion=motion,
            position=entry.position,
            rotation=rotation,
        )
    return Body(
        shape,
        name=name,
        friction=entry.friction,
        motion=_moving(field, entry, rotation, parameters),
        rotation=rotation,
    )


def _moving(
    field: str, entry: ClothBodyEntry, rotation: Vector | None, parameters: ClothParameters
) -> Prescribed:
    """A keyframe for every step: at the end of each, the body is where its motion says."""
    if entry.stop is not None and entry.stop < entry.start + entry.ramp:
        raise InputError(f"{field}.stop", entry.stop, "not before the body is up to speed, start + ramp (s)")
    step, end = parameters.time.step, parameters.time.end
    times = np.array([step * k for k in range(int(np.ceil(end / step)) + 1 + _AFTER)])
    way = driven_time(entry, times)
    sine = np.sin(2.0 * np.pi * entry.frequency * np.maximum(times - entry.start, 0.0))
    places = np.array(entry.position) + np.outer(way, entry.velocity) + np.outer(sine, entry.amplitude)
    first = identity(3) if rotation is None else rotation
    turns = np.outer(way, entry.spin) + np.outer(sine, np.radians(entry.swing))
    return Prescribed(times, places, np.array([product(exponential(turn), first) for turn in turns]))


def driven_time(entry: ClothBodyEntry, times: Vector) -> Vector:
    """What multiplies velocity and spin: time since the start, with speed ramped up, and down from `stop` on, as a cosine."""

    def begun(since: Vector) -> Vector:
        if entry.ramp == 0.0:
            return np.maximum(since, 0.0)
        x = np.clip(since / entry.ramp, 0.0, 1.0)
        speeding = 0.5 * entry.ramp * (x - np.sin(np.pi * x) / np.pi)
        return speeding + np.maximum(since - entry.ramp, 0.0)

    way = begun(times - entry.start)
    return way if entry.stop is None else way - begun(times - entry.stop)


def build_assembly(parameters: ClothParameters, cloth: Cloth, bodies: list[Body]) -> ClothAssembly:
    """What steps the cloth. Raises InputError for a solver that does not exist."""
    contact, solver = parameters.contact, parameters.solver
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    options = ClothOptions(
        tolerance=solver.tolerance, method=solver.method, max_sweeps=solver.max_sweeps, iterations=solver.iterations,
        recovery=contact.recovery, margin=contact.margin, self_contact=contact.self_contact, mixing=contact.mixing,
    )  # fmt: skip
    return ClothAssembly(cloth, bodies, parameters.gravity_vector, options)
