"""The nodal form of a friction problem (seed B 4.3.1 and 4.3.3): velocities in an orthonormal basis that holds the contacts.

u_i / c_i = y_i + w_i / c_i with y = G v, G orthonormal, so that G M G^T y = G f + r c: as sparse as M, and no inverse of M.
A contact of vertices j with weights a_j, H_ij = a_j E_i^T, is scaled to unit weights (c_i = |a|; the law does not mind) and
completed by a Householder reflection of the weights: the rule of Eq. (4.15) for one vertex, that of 4.3.3 for two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction.local import local_blocks
from barchan.friction.methods.nodal._kernels import turn_blocks
from barchan.friction.problem import Problem
from barchan.linalg import BlockRows, block_rows

SIZE = 3
TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class NodalForm:
    """What depends on M and H alone, for m nodes and n contacts.

    turn : G, sparse (3 m, 3 m).  matrix : G M G^T as rows of 3 x 3 blocks, with the places of its diagonal blocks.
    blocks : diagonal blocks (m, 3, 3) and their inverses.  local : decompositions of both for the contacts.
    contact : (m,) the contact of a node or -1.  nodes : (n,) the node of a contact.  scale : (n,) c.
    rho : (n,) force over velocity at least that of the certificate: 3 / Tr(A_ii^-1) >= 3 / Tr(W_ii), A = G M G^T / c^2, so that
    natural maps measured with it bound the certificate's.
    """

    turn: sp.sparray
    matrix: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    blocks: tuple[np.ndarray, np.ndarray]
    local: tuple[np.ndarray, np.ndarray]
    contact: np.ndarray
    nodes: np.ndarray
    scale: np.ndarray
    rho: np.ndarray


@dataclass(frozen=True, eq=False)
class _Rows:
    """Contacts in order, of `count` (n,) vertices each, with `vertices` and `weights` (k,) in all; their frames (n, 3, 3)."""

    count: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray
    frames: np.ndarray


def applicable(problem: Problem) -> bool:
    """Whether the nodal method takes this problem: see the errors of `nodal_form`."""
    try:
        _rows_of(problem)
    except InputError:
        return False
    return True


def nodal_form(problem: Problem) -> NodalForm:
    """The form of a problem and its variants, made once. Cost: linear in the entries of M.

    Raises
    ------
    InputError : reduced problem, bilateral rows, blocks or velocities that are not of 3 components, a contact without
        vertices or whose blocks are not weights times one rotation, a vertex of two contacts.
    """
    form: NodalForm = problem.origin.prepared("nodal form", lambda: _make(problem.origin))
    return form


def _make(problem: Problem) -> NodalForm:
    contacts = _rows_of(problem)
    m, n = problem.size // SIZE, problem.n
    scale = np.sqrt(np.bincount(_owner(contacts.count), contacts.weights**2, minlength=n))
    nodes = contacts.vertices[np.cumsum(contacts.count) - contacts.count]
    turn = _completed(contacts, scale, m)
    rows = _turned(problem, contacts, scale, turn)
    row = np.repeat(np.arange(m), np.diff(rows.indptr))
    middle = np.flatnonzero(row == rows.indices)
    diagonal = np.ascontiguousarray(rows.data[middle])
    inverses = np.ascontiguousarray(np.linalg.inv(diagonal))
    contact = np.full(m, -1)
    contact[nodes] = np.arange(n)
    local = (local_blocks(inverses[nodes])[1], local_blocks(diagonal[nodes])[1])
    rho = SIZE / np.trace(inverses[nodes], axis1=1, axis2=2) / scale**2
    matrix = (rows.indptr, rows.indices, rows.data, middle)
    return NodalForm(turn, matrix, (diagonal, inverses), local, contact, nodes, scale, rho)


def _owner(count: np.ndarray) -> np.ndarray:
    return np.repeat(np.arange(len(count)), count)


def _refuse_kind(problem: Problem) -> None:
    if problem.is_reduced:
        raise InputError("method", "nodal", "another one for a reduced problem: it has no M and H")
    if problem.C is not None:
        raise InputError("method", "nodal", "another one for a problem with bilateral constraints")
    if problem.s != SIZE or problem.size % SIZE:
        says = f"another one for blocks of size {problem.s} and {problem.size} velocities: nodes have three components"
        raise InputError("method", "nodal", says)


def _rows_of(problem: Problem) -> _Rows:
    """The contacts as weights times rotations, checked."""
    _refuse_kind(problem)
    rows = problem.h_rows if problem.velocity_block == SIZE else block_rows(problem.H, SIZE, SIZE)
    size = np.sqrt((rows.data**2).sum(axis=(1, 2)) / SIZE)
    owner = _owner(np.diff(rows.indptr))
    largest = np.zeros(problem.n)
    np.maximum.at(largest, owner, size)
    if not (largest > 0.0).all():
        raise InputError(
            "H", f"contact {int(np.argmin(largest))} without a vertex", "a vertex for every contact"
        )
    kept = size > TOLERANCE * largest[owner]
    owner, vertices, blocks, size = owner[kept], rows.indices[kept], rows.data[kept], size[kept]
    first = np.lexsort((-size, owner))[np.searchsorted(owner, np.arange(problem.n))]
    frames = blocks[first] / size[first][:, None, None]
    weights = np.einsum("eab,eab->e", blocks, frames[owner]) / SIZE
    off = (
        np.abs(blocks - weights[:, None, None] * frames[owner]).max(axis=(1, 2), initial=0.0) / largest[owner]
    )
    skew = np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(SIZE)).max(axis=(1, 2), initial=0.0)
    np.maximum.at(skew, owner, off)
    if (skew > TOLERANCE).any():
        worst = int(np.argmax(skew))
        raise InputError(
            "H", f"contact {worst}, whose blocks are not weights times one rotation", "of that form"
        )
    _refuse_shared(owner, vertices)
    return _Rows(np.bincount(owner, minlength=problem.n), vertices, weights, frames)


def _refuse_shared(owner: np.ndarray, vertices: np.ndarray) -> None:
    order = np.argsort(vertices, kind="stable")
    twice = np.flatnonzero(np.diff(vertices[order]) == 0)
    if len(twice):
        first, second = owner[order[twice[0]]], owner[order[twice[0] + 1]]
        says = f"contacts {first} and {second} that share vertex {vertices[order[twice[0]]]}"
        raise InputError("H", says, "at most one contact a vertex, for the nodal method")


def _completed(contacts: _Rows, scale: np.ndarray, m: int) -> sp.sparray:
    """G: the unit matrix, and for each contact Q (x) E^T on its vertices, Q = I - 2 h h^T with first row a / |a|."""
    alone = np.ones(m, bool)
    alone[contacts.vertices] = False
    others = np.flatnonzero(alone)
    rows, columns, blocks = [others], [others], [np.broadcast_to(np.eye(SIZE), (len(others), SIZE, SIZE))]
    first = np.cumsum(contacts.count) - contacts.count
    for k in np.unique(contacts.count):
        chosen = np.flatnonzero(contacts.count == k)
        places = first[chosen][:, None] + np.arange(k)
        members, weights = contacts.vertices[places], contacts.weights[places] / scale[chosen][:, None]
        mirror = weights - np.eye(k)[0]
        square = (mirror**2).sum(axis=1)
        factor = np.divide(2.0, square, out=np.zeros_like(square), where=square > 0.0)
        reflected = np.eye(k) - factor[:, None, None] * mirror[:, :, None] * mirror[:, None, :]
        rows.append(np.repeat(members, k, axis=1).ravel())
        columns.append(np.tile(members, (1, k)).ravel())
        product = reflected[:, :, :, None, None] * contacts.frames[chosen][:, None, None]
        blocks.append(product.reshape(-1, SIZE, SIZE))
    row, column = np.concatenate(rows), np.concatenate(columns)
    order = np.lexsort((column, row))
    pointers = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=m))])
    shape = (m * SIZE, m * SIZE)
    return sp.bsr_array((np.concatenate(blocks)[order], column[order], pointers), shape=shape)


def _turned(problem: Problem, contacts: _Rows, scale: np.ndarray, turn: sp.sparray) -> BlockRows:
    """G M G^T: block by block where every contact has one vertex, else as a product."""
    m = problem.size // SIZE
    rows = block_rows(problem.M, SIZE, SIZE)
    if contacts.count.max(initial=1) > 1:
        return block_rows(turn @ rows.matrix() @ turn.T, SIZE, SIZE)
    turned, frames = np.zeros(m, bool), np.zeros((m, SIZE, SIZE))
    turned[contacts.vertices] = True
    frames[contacts.vertices] = contacts.frames
    turn_blocks(rows.indptr, rows.indices, rows.data, turned, frames)
    return rows
