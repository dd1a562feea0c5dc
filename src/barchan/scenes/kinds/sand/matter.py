"""The particles of a scene at its start: pieces of matter filled, cut to shape, and kept out of the bodies.

A piece is a lattice of bricks over its bounds. A brick that the boundary of the piece or of a body cuts keeps the share of
its volume that lies inside, at the centre of that part, so that round pieces have no steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, Shape
from barchan.bodies.rigid.rotations import matrix
from barchan.errors import InputError
from barchan.flows.mpm import Material, State, fill_box
from barchan.scenes.kinds.sand.entries import Piece, PieceOfMatter
from barchan.scenes.kinds.sand.parameters import SandParameters
from barchan.scenes.kinds.sand.shapes import shape_of_piece
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]

SMALLEST_SHARE = 0.05  # of a brick that is kept as a particle
_SAMPLES = 4  # along each edge of a brick that a boundary may cut


def fill_piece(
    field: str,
    piece: Piece,
    grid: RegularGrid,
    per_cell: int,
    material: Material,
    bodies: Sequence[Body],
) -> tuple[Vector, Vector]:
    """Positions (P, d) m and volumes (P,) m^d of the particles of a piece. Raises InputError when there are none."""
    shape = shape_of_piece(field, piece, grid.dimension)
    lower, upper = shape.bounds()
    slack = 1e-9 * (grid.upper - grid.origin)
    if np.any(lower < grid.origin - slack) or np.any(upper > grid.upper + slack):
        raise InputError(
            field, f"from {_text(lower)} to {_text(upper)}", f"inside the box, up to {_text(grid.upper)} m"
        )
    full = fill_box(grid, np.maximum(lower, grid.origin), np.minimum(upper, grid.upper), per_cell, material)
    positions, volumes = full.positions, full.volumes
    brick = grid.spacing / per_cell
    if piece.shape != "box" or piece.rotation is not None:
        positions, volumes = cut(positions, volumes, brick, shape)
    for body in bodies:
        positions, volumes = cut_by_body(positions, volumes, brick, body)
    if len(volumes) == 0:
        raise InputError(field, f"from {_text(lower)} to {_text(upper)}", "not wholly inside a body")
    return positions, volumes


def cut(positions: Vector, volumes: Vector, brick: Vector, shape: Shape) -> tuple[Vector, Vector]:
    """The parts of bricks with edges `brick` (d,) m that lie inside a shape: positions (Q, d) and volumes (Q,)."""
    return _kept(positions, volumes, brick, shape.signed_distance)


def cut_by_body(positions: Vector, volumes: Vector, brick: Vector, body: Body) -> tuple[Vector, Vector]:
    """The parts of bricks that lie outside of a body, as it is at the start."""
    rotation = matrix(body.rotation)

    def inside_of_room(points: Vector) -> Vector:
        return np.asarray(-body.shape.signed_distance((points - body.position) @ rotation))

    return _kept(positions, volumes, brick, inside_of_room)


def _kept(
    positions: Vector, volumes: Vector, brick: Vector, distance: Callable[[Vector], Vector]
) -> tuple[Vector, Vector]:
    """What is left of bricks where `distance` (n,) of points (n, d) is negative, counted on a lattice in each cut brick."""
    d = positions.shape[1]
    middle = distance(positions)
    share = (middle < 0.0).astype(np.float64)
    moved = positions.copy()
    near = np.flatnonzero(np.abs(middle) < 0.5 * float(np.linalg.norm(brick)))
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    offsets = np.stack(np.meshgrid(*[steps] * d, indexing="ij"), axis=-1).reshape(-1, d) * brick
    for chunk in np.array_split(near, max(1, len(near) // 20_000)):
        points = positions[chunk][:, None, :] + offsets
        inside = (distance(points.reshape(-1, d)) < 0.0).reshape(len(chunk), len(offsets))
        found = inside.sum(axis=1)
        share[chunk] = found / len(offsets)
        moved[chunk] += (inside @ offsets) / np.maximum(found, 1)[:, None]
    chosen = share > SMALLEST_SHARE
    return moved[chosen], (share * volumes)[chosen]


def initial_state(
    parameters: SandParameters, grid: RegularGrid, materials: Sequence[Material], bodies: Sequence[Body]
) -> State:
    """The particles of all pieces at time 0: where they are, how fast, of which material, oriented how."""
    names = list(parameters.all_materials())
    positions, volumes, velocities, kinds, orientations = [], [], [], [], []
    for name, piece in parameters.pieces():
        number = names.index(piece.material)
        points, sizes = fill_piece(
            f"matter.{name}", piece, grid, parameters.particles.per_cell, materials[number], bodies
        )
        count, d = points.shape
        velocity = np.zeros(d) if piece.velocity is None else np.array(piece.velocity, dtype=np.float64)
        positions.append(points)
        volumes.append(sizes)
        velocities.append(np.tile(velocity, (count, 1)))
        kinds.append(np.full(count, number, dtype=np.int32))
        orientations.append(np.tile(orientation_of(name, piece, d), (count, 1, 1)))
    state = State.at_start(np.concatenate(positions), np.concatenate(volumes), np.concatenate(velocities))
    state = replace(state, materials=np.concatenate(kinds))
    if materials[0].anisotropy > 0.0:
        state = replace(state, orientations=np.concatenate(orientations))
    return state


def orientation_of(name: str, piece: PieceOfMatter, dimension: int) -> Vector:
    """Second moment (d, d) of the normals of a piece's grains at the start (seed B 7.4.2)."""
    if piece.orientation == "random":
        return np.eye(dimension) / dimension
    normal = np.eye(dimension)[-1] if piece.normal is None else np.array(piece.normal, dtype=np.float64)
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        raise InputError(f"matter.{name}.normal", piece.normal, "a vector that is not zero")
    return np.outer(normal, normal) / length**2


def _text(corner: Vector) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in corner) + ")"
