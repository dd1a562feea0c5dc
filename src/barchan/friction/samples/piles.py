"""Piles of discs or spheres in a box, one Moreau-Jean time step of them: sizes from ten to 1e5 contacts in seconds.

M v = M v_k + dt f_ext + H^T r, u = H v + w with w_N = gap / dt + e u_N,k (seed B Eqs. 2.14-2.16, alpha = 1). Bodies sit on
hexagonal layers, shaken and unequal as asked; near pairs are found by a k-d tree. Contacts follow the bodies, bottom up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction.problem import Problem
from barchan.friction.samples.known import block_jacobian
from barchan.linalg.frames import contact_frames

DENSITY = 2600.0  # kg/m^3; per metre of thickness in 2D
GRAVITY = 9.81  # m/s^2
CLOSED = 1e-9  # of the radius: a gap of round-off is none
GROUND = -1


@dataclass(frozen=True, eq=False)
class Pile:
    """A pile in a box at the beginning of a time step.

    positions : (bodies, d) m, the last axis upwards.  radii : (bodies,) m.  masses : (bodies,) kg.
    bodies : (n, 2) of each contact, the second GROUND at floor and walls.
    frames : (n, d, d), rows the normal (towards the first body) and the tangents.  gaps : (n,) m, negative in overlap.
    floor : (n,) mask of the contacts with the floor.  weight : momentum that gravity adds in the step, kg m/s.
    """

    problem: Problem
    positions: np.ndarray
    radii: np.ndarray
    masses: np.ndarray
    bodies: np.ndarray
    frames: np.ndarray
    gaps: np.ndarray
    floor: np.ndarray
    weight: float

    def lift(self, r: np.ndarray) -> np.ndarray:
        """(n,) upward part of the impulses r (n d,) or (n, d) on the first body of each contact, kg m/s."""
        r = np.asarray(r).reshape(self.frames.shape[:2])
        return np.asarray(np.einsum("ik,ik->i", r, self.frames[:, :, -1]))


def pile(
    n_bodies: int,
    seed: int = 0,
    mu: float | tuple[float, float] = 0.5,
    dimension: int = 3,
    *,
    radius: float = 0.01,
    jitter: float = 0.01,
    spread: float = 0.0,
    reach: float = 0.05,
    closed: bool = False,
    uneven: bool = False,
    slenderness: float = 1.0,
    time_step: float = 0.005,
    speed: float = 0.0,
    restitution: float = 0.0,
) -> Pile:
    """A heap of n_bodies discs (2D) or spheres (3D) in a box with floor and walls, under gravity.

    A body has 3 unknowns (2D) or 6 (3D): velocity, then spin. In 3D there are some 5 contacts a body, in 2D some 3.

    Parameters
    ----------
    mu : friction coefficient, or the bounds of a uniform draw.  radius : largest radius, m.
    jitter : standard deviation of the displacement of a body from its site, in radii.
    spread : radii are drawn from [1 - spread, 1] times `radius`.  reach : contacts up to this gap are kept, in radii.
    closed : counts every gap as closed (a pile at rest), else w_N = gap / time_step.
    uneven : bodies of unequal principal inertia, turned at random, so that M is block-diagonal; else M is diagonal (3D only).
    slenderness : height over width of the box.  time_step : s.
    speed : standard deviation of the velocities at the beginning, m/s.
    restitution : Newton's, on closed contacts. With it bodies wedged between walls may leave the problem without solution;
        without it standing still is admissible for any pile (w_N >= 0, w_T = 0).

    Raises
    ------
    InputError : n_bodies < 1, dimension other than 2 or 3, or a length, time or coefficient out of range.
    """
    _check(n_bodies, mu, dimension, radius, jitter, spread, reach, slenderness, time_step, speed, restitution)
    rng = np.random.default_rng(seed)
    positions, box = _sites(n_bodies, dimension, 2.0 * radius, slenderness)
    positions = positions + jitter * radius * rng.standard_normal(positions.shape)
    radii = radius * (1.0 - spread * rng.random(n_bodies))
    bodies, normals, gaps = _near_contacts(positions, radii, box, reach * radius)
    frames = contact_frames(normals)
    H = _jacobian(bodies, frames, radii)
    masses, M = _mass(rng, radii, dimension, uneven)
    dof = H.shape[1] // n_bodies
    before = np.zeros((n_bodies, dof))
    before[:, :dimension] = speed * rng.standard_normal((n_bodies, dimension))
    pull = np.zeros((n_bodies, dof))
    pull[:, dimension - 1] = -GRAVITY * masses
    opening = np.where((gaps <= CLOSED * radius) | closed, 0.0, gaps)
    w = np.zeros((len(gaps), dimension))
    approach = np.minimum((H @ before.ravel())[::dimension], 0.0)
    w[:, 0] = opening / time_step + np.where(opening == 0.0, restitution * approach, 0.0)
    friction = (
        np.full(len(gaps), float(mu)) if not isinstance(mu, tuple) else rng.uniform(*mu, size=len(gaps))
    )
    problem = Problem(
        M=M,
        f=M @ before.ravel() + time_step * pull.ravel(),
        H=H,
        w=w.ravel(),
        law=Coulomb(friction),
        block_size=dimension,
    )
    floor = (bodies[:, 1] == GROUND) & (normals[:, -1] == 1.0)
    weight = float(GRAVITY * time_step * masses.sum())
    return Pile(problem, positions, radii, masses, bodies, frames, gaps, floor, weight)


def _check(
    n_bodies: int,
    mu: object,
    dimension: int,
    radius: float,
    jitter: float,
    spread: float,
    reach: float,
    slenderness: float,
    time_step: float,
    speed: float,
    restitution: float,
) -> None:
    if n_bodies < 1:
        raise InputError("n_bodies", n_bodies, "at least 1")
    if dimension not in (2, 3):
        raise InputError("dimension", dimension, "2 or 3")
    bounds = mu if isinstance(mu, tuple) else (mu, mu)
    if len(bounds) != 2 or not 0.0 <= bounds[0] <= bounds[1] < np.inf:
        raise InputError("mu", mu, "a finite number >= 0, or (least, largest)")
    for name, value in (("radius", radius), ("slenderness", slenderness), ("time_step", time_step)):
        if not 0.0 < value < np.inf:
            raise InputError(name, value, "finite and above 0")
    for name, value in (("jitter", jitter), ("reach", reach), ("speed", speed)):
        if not 0.0 <= value < np.inf:
            raise InputError(name, value, "finite and at least 0")
    for name, value in (("spread", spread), ("restitution", restitution)):
        if not 0.0 <= value < 1.0:
            raise InputError(name, value, "at least 0 and below 1")


def _sites(
    count: int, dimension: int, spacing: float, slenderness: float
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Sites (count, d) of hexagonal layers that touch each other, bottom up, and the two corners (d,) of the box."""
    rise = np.sqrt(3.0) / 2.0 if dimension == 2 else np.sqrt(2.0 / 3.0)
    width = max(1, round((count * rise / slenderness) ** (1.0 / dimension)))
    depth = 1 if dimension == 2 else max(1, round(width * 2.0 / np.sqrt(3.0)))
    layer, place = np.divmod(np.arange(count), width * depth)
    row, column = np.divmod(place, width)
    if dimension == 2:
        sites = np.column_stack([column + 0.5 * (layer % 2), rise * layer])
    else:
        # Layers A and B of a hexagonal close packing: B sits in the hollows of A.
        across = np.sqrt(3.0) / 2.0 * row + (layer % 2) / np.sqrt(3.0)
        sites = np.column_stack([column + 0.5 * (row % 2), across, rise * layer])
    sites = spacing * (sites + 0.5)
    return sites, (np.zeros(dimension), sites.max(axis=0) + 0.5 * spacing)


def _near_contacts(
    positions: np.ndarray, radii: np.ndarray, box: tuple[np.ndarray, np.ndarray], reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bodies (n, 2), normals (n, d) towards the first body and gaps (n,) of all contacts, in the order of the bodies."""
    tree = cKDTree(positions)
    pairs = tree.query_pairs(2.0 * radii.max() + reach, output_type="ndarray").astype(np.int64)
    pairs = pairs[:, ::-1]  # the higher body first: its normal points upwards
    apart = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    distance = np.linalg.norm(apart, axis=1)
    bodies, normals, gaps = [pairs], [apart / distance[:, None]], [distance - radii[pairs].sum(axis=1)]
    dimension = positions.shape[1]
    sides = [(axis, 1.0, box[0][axis]) for axis in range(dimension)]
    sides += [(axis, -1.0, box[1][axis]) for axis in range(dimension - 1)]
    for axis, sign, wall in sides:
        normal = np.zeros(dimension)
        normal[axis] = sign
        bodies.append(np.column_stack([np.arange(len(radii)), np.full(len(radii), GROUND)]))
        normals.append(np.tile(normal, (len(radii), 1)))
        gaps.append(sign * (positions[:, axis] - wall) - radii)
    every = np.concatenate(bodies), np.concatenate(normals), np.concatenate(gaps)
    kept = np.flatnonzero(every[2] <= reach)
    order = kept[np.lexsort((every[0][kept, 1], every[0][kept, 0]))]
    return every[0][order], every[1][order], every[2][order]


def _jacobian(bodies: np.ndarray, frames: np.ndarray, radii: np.ndarray) -> sp.bsr_array:
    """H: velocity of the first body at the contact point minus that of the second, in the contact frame."""
    normal = frames[:, None, 0]
    first, second = bodies.T
    near_arm = -radii[first][:, None, None] * normal
    far_arm = radii[second][:, None, None] * normal
    near = np.concatenate([frames, _spin_rows(near_arm, frames)], axis=2)
    far = -np.concatenate([frames, _spin_rows(far_arm, frames)], axis=2)
    return block_jacobian(first, second, near, far, len(radii))


def _spin_rows(arm: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Rows (n, d, 1 or 3) that take the spin to the velocity of the end of `arm` (n, 1, d): t . (spin x arm)."""
    if frames.shape[2] == 2:
        return arm[:, :, :1] * frames[:, :, 1:] - arm[:, :, 1:] * frames[:, :, :1]
    return np.cross(np.broadcast_to(arm, frames.shape), frames)


def _mass(
    rng: np.random.Generator, radii: np.ndarray, dimension: int, uneven: bool
) -> tuple[np.ndarray, sp.csr_array]:
    """Masses (bodies,) and M: translation, then inertia."""
    masses = DENSITY * (np.pi * radii**2 if dimension == 2 else 4.0 / 3.0 * np.pi * radii**3)
    if dimension == 2:
        inertia = (0.5 * masses * radii**2)[:, None]
    else:
        inertia = np.repeat((0.4 * masses * radii**2)[:, None], 3, axis=1)
    if not (uneven and dimension == 3):
        diagonal = np.concatenate([np.repeat(masses[:, None], dimension, axis=1), inertia], axis=1)
        return masses, sp.csr_array(sp.diags_array(diagonal.ravel()))
    axes = np.linalg.qr(rng.standard_normal((len(radii), 3, 3)))[0]
    moments = inertia * rng.uniform(0.75, 1.25, inertia.shape)
    turned = np.einsum("iab,ib,icb->iac", axes, moments, axes)
    blocks = np.zeros((2 * len(radii), 3, 3))
    blocks[::2] = masses[:, None, None] * np.eye(3)
    blocks[1::2] = 0.5 * (turned + turned.transpose(0, 2, 1))
    places = np.arange(len(blocks) + 1, dtype=np.int32)
    M = sp.csr_array(sp.bsr_array((blocks, places[:-1], places), shape=(3 * len(blocks),) * 2))
    M.eliminate_zeros()
    return masses, M
