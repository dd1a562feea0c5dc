"""A step of NVIDIA Newton's implicit MPM as a problem of ours, so that one certificate judges both programs.

Newton lumps the mass, takes strain increments 2 Sym(grad u) dt per cell volume, Coulomb's law in the coordinates of seed B's
map chi and contacts with its floor: the discrete Coulomb friction problem of seed B, Eq. 7.23, in other names and units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan import friction
from barchan.cones import Coulomb, chi_inverse
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames

SIZE = 6  # of a block
_ROOT_THIRD = float(np.sqrt(1.0 / 3.0))
Arrays = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Scale:
    """What Newton's arrays leave out.

    voxel : edge of its cells [m].  dt : step [s].  density : [kg/m^3].  stress : typical stress [Pa], for the certificate.
    """

    voxel: float
    dt: float
    density: float
    stress: float


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """The friction problem of a step and Newton's answer.

    problem : n blocks of size 6, in the units of `flows.mpm` but for the velocity rows (momentum per cell volume): r is in
        Pa, contact stresses first, then tractions of the floor.
    v : (m,) velocities and r, start : (n, 6) its answer and the start it had [Pa].
    """

    problem: friction.Problem
    v: NDArray[np.float64]
    r: NDArray[np.float64]
    start: NDArray[np.float64]

    @property
    def certificate(self) -> friction.Certificate:
        """Our certificate of Newton's answer."""
        return friction.certify(self.problem, self.r, self.v)


def newton_step(kept: Arrays, scale: Scale) -> NewtonStep:
    """The step from the arrays that `_newton_child` keeps.

    Raises
    ------
    InputError : for matter that is not Newton's rigid, cohesionless sand: the only law that has our form.
    """
    _check(kept)
    masses = 1.0 / _floats(kept["inverse_masses"])
    strain, offsets = _strain_rows(kept)
    contacts = _Contacts.of(kept, masses, scale)
    parameters = _floats(kept["yield_parameters"])
    limit = parameters[:, 0]
    slopes = np.divide(parameters[:, 3], limit, out=np.zeros_like(limit), where=limit > 0.0)
    diagonal = np.repeat(masses, 3)
    count = len(slopes) + len(contacts.friction)
    problem = friction.Problem(
        M=sp.dia_array((diagonal[None, :], [0]), shape=(len(diagonal), len(diagonal))),
        f=diagonal * _floats(kept["free_velocities"]).reshape(-1),
        H=sp.vstack([strain, contacts.rows], format="bsr"),
        w=np.concatenate([offsets, contacts.offsets]).reshape(-1),
        law=Coulomb(np.concatenate([slopes, contacts.friction])),
        block_size=SIZE,
        reference_force=scale.stress * float(np.sqrt(count)),
    )
    velocities = _floats(kept["velocities"]).reshape(-1)
    r = np.concatenate([_stress(kept["stresses"]), contacts.tractions(kept["wall_impulses"])])
    start = np.concatenate([_stress(kept["stresses_before"]), contacts.tractions(kept["impulses_before"])])
    return NewtonStep(problem, velocities, r, start)


def _check(kept: Arrays) -> None:
    parameters = _floats(kept["yield_parameters"])
    for name, size in (
        ("compliance", np.max(np.abs(_floats(kept["compliance"])), initial=0.0)),
        ("tensile yield", np.max(np.abs(parameters[:, 1]), initial=0.0)),
        ("shear yield", np.max(np.abs(parameters[:, 2]), initial=0.0)),
        ("dilatancy", np.max(np.abs(parameters[:, 4]), initial=0.0)),
    ):
        if size > 0.0:
            raise InputError(f"newton.{name}", float(size), "0 (rigid sand without cohesion)")


def _strain_rows(kept: Arrays) -> tuple[sp.bsr_array, NDArray[np.float64]]:
    """H of the stresses (n 6, m), and w (n, 6), the room that is left [strain]."""
    gradients = _floats(
        kept["strain_values"]
    )  # row b of block (i, j): u_j adds 2 Sym(u_j (x) b) to the strain i
    outer = np.einsum("kc,je->kjec", 2.0 * gradients, np.eye(3))
    blocks = chi_inverse(0.5 * (outer + outer.swapaxes(2, 3))).swapaxes(1, 2)
    count, nodes = len(kept["stresses"]), len(kept["inverse_masses"])
    rows = sp.bsr_array(
        (np.ascontiguousarray(blocks), kept["strain_columns"], kept["strain_offsets"][: count + 1]),
        shape=(SIZE * count, 3 * nodes),
        blocksize=(SIZE, 3),
    )
    offsets = _stress(kept["strain"])
    offsets[:, 0] += np.sqrt(2.0 / 3.0) * _floats(kept["strain_offset"])
    return rows, offsets


@dataclass(frozen=True, eq=False)
class _Contacts:
    """Contacts with the floor: rows (k 6, m), offsets (k, 6), friction (k,), and what turns impulses into tractions."""

    numbers: NDArray[np.int64]
    frames: NDArray[np.float64]
    areas: NDArray[np.float64]
    rows: sp.bsr_array
    offsets: NDArray[np.float64]
    friction: NDArray[np.float64]

    @classmethod
    def of(cls, kept: Arrays, masses: NDArray[np.float64], scale: Scale) -> _Contacts:
        """Where Newton has a contact: a row that is not empty and a coefficient that is not negative.

        As in `flows.mpm` a contact stands for the area of its matter over half a cell, here times dt per cell volume,
        so that r is a traction.
        """
        coefficients = _floats(kept["wall_friction"])
        starts, columns, values = _wall_rows(kept, len(coefficients))
        lengths = np.diff(starts)
        numbers = np.flatnonzero((lengths > 0) & (coefficients >= 0.0))
        taken = np.repeat(np.isin(np.arange(len(lengths)), numbers), lengths)
        columns, values, lengths = columns[taken], values[taken], lengths[numbers]
        owner = np.repeat(np.arange(len(numbers)), lengths)
        matter = np.bincount(owner, values * masses[columns], minlength=len(numbers)) / scale.density
        areas = 2.0 * scale.dt / scale.voxel * matter
        normals = _floats(kept["wall_normals"])[numbers]
        frames = contact_frames(normals / np.linalg.norm(normals, axis=1, keepdims=True))
        blocks = np.zeros((len(columns), SIZE, 3))
        blocks[:, :3] = (areas[owner] * values)[:, None, None] * frames[owner]
        rows = sp.bsr_array(
            (blocks, columns, np.concatenate([[0], np.cumsum(lengths)])),
            shape=(SIZE * len(numbers), 3 * len(masses)),
            blocksize=(SIZE, 3),
        )
        offsets = np.zeros((len(numbers), SIZE))
        offsets[:, :3] = -areas[:, None] * _turned(frames, _floats(kept["wall_velocities"])[numbers])
        return cls(numbers, frames, areas, rows, offsets, coefficients[numbers])

    def tractions(self, impulses: NDArray[np.generic]) -> NDArray[np.float64]:
        """(k, 6) tractions [Pa] of Newton's impulses."""
        found = np.zeros((len(self.numbers), SIZE))
        turned = _turned(self.frames, _floats(impulses)[self.numbers])
        np.divide(turned, self.areas[:, None], out=found[:, :3], where=self.areas[:, None] > 0.0)
        return found


def _wall_rows(kept: Arrays, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Compressed rows of the weights of the velocities at the contacts; contacts at the nodes themselves have no matrix."""
    if kept["wall_values"].size == 0:
        numbers = np.arange(count, dtype=np.int64)
        return np.arange(count + 1, dtype=np.int64), numbers, np.ones(count)
    starts = np.asarray(kept["wall_offsets"], dtype=np.int64)[: count + 1]
    columns = np.asarray(kept["wall_columns"], dtype=np.int64)
    return starts, columns, _floats(kept["wall_values"])[:, 0]


def _turned(frames: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("kij,kj->ki", frames, vectors))


def _stress(coordinates: NDArray[np.generic]) -> NDArray[np.float64]:
    """(n, 6) our coordinates of tensors in Newton's: the same isometry, its shears in the order yz, xz, xy."""
    a, b, c, yz, xz, xy = _floats(coordinates).T
    a, c = np.sqrt(2.0) * _ROOT_THIRD * a, _ROOT_THIRD * c
    rows = ((a + b - c, xy, xz), (xy, a - b - c, yz), (xz, yz, a + 2.0 * c))
    return chi_inverse(np.moveaxis(np.array(rows), 2, 0))


def _floats(values: NDArray[np.generic]) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)
