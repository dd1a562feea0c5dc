"""Token files `.dat`: reduced and global frictional contact problems as Siconos writes them.

Reduced: dimension, n, matrix W, b, mu. Global: dimension, n, matrix M (m, m), matrix H^T (m, n s), f, w, mu,
in the signs M v = f + H^T r, u = H v + w (seed B, 2.2). Either may end with a flag 0 or 1 ("complete"), which
says nothing. A reduced plasticity problem has a second row of n coefficients theta, those of the shift theta
|u_T| e_N; the dilatancy is zeta = mu - theta (ERRATA 3). The block size s is the dimension.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.friction.files.arrays import ProblemArrays, canonical, require_sound
from barchan.friction.files.matrices import read_matrix
from barchan.friction.files.tokens import TokenReader
from barchan.storage import replacing

_FLAGS = (b"0", b"1")


def read_dat(path: Path) -> ProblemArrays:
    """Read a `.dat` file; what follows the first matrix tells a reduced problem from a global one.

    Raises
    ------
    InputError : truncated, foreign or inconsistent file, numbers that are not finite, mu < 0.
    """
    reader = TokenReader.open(path)
    dimension, count = reader.integer("dimension"), reader.integer("number of contacts")
    if dimension not in (2, 3):
        raise reader.wrong("dimension", dimension, "2 or 3 (is this a problem file?)")
    size = dimension * count
    matrix = read_matrix(reader, "the first matrix")
    # A second matrix and its vectors take more tokens than the vectors of a reduced problem ever do.
    if matrix.shape == (size, size) and reader.remaining <= size + 2 * count + 1:
        arrays = _read_reduced(reader, dimension, count, matrix)
    else:
        arrays = _read_global(reader, dimension, count, matrix)
    if reader.remaining:
        extra = reader.tokens[reader.position].decode("ascii", errors="replace")
        raise reader.wrong(
            "end of file", f"{reader.remaining} more tokens from {extra}", "where the sizes say"
        )
    require_sound(arrays, str(path))
    return arrays


def _read_reduced(reader: TokenReader, dimension: int, count: int, W: sp.csr_array) -> ProblemArrays:
    b = reader.reals("q", dimension * count)
    mu = reader.reals("mu", count)
    _skip_flag(reader)
    dilatancy = None
    if count and reader.remaining >= count:
        dilatancy = mu - reader.reals("theta", count)
        _skip_flag(reader)
        if not np.any(dilatancy):  # theta = mu: Coulomb's law in so many words
            dilatancy = None
    return ProblemArrays(dimension, dimension, mu, W=W, b=b, dilatancy=dilatancy)


def _read_global(reader: TokenReader, dimension: int, count: int, M: sp.csr_array) -> ProblemArrays:
    if M.shape[0] != M.shape[1]:
        raise reader.wrong("shape of the first matrix", M.shape, "square")
    if not reader.remaining:
        raise reader.wrong("shape of W", M.shape, f"{(dimension * count, dimension * count)}")
    H = canonical(read_matrix(reader, "H").T)
    f = reader.reals("f", M.shape[0])
    w = reader.reals("w", dimension * count)
    mu = reader.reals("mu", count)
    _skip_flag(reader)
    return ProblemArrays(dimension, dimension, mu, M=M, f=f, H=H, w=w)


def _skip_flag(reader: TokenReader) -> None:
    """Pass over a final flag; a coefficient is written with a decimal point and is no flag."""
    if reader.remaining == 1 and reader.tokens[-1] in _FLAGS:
        reader.words("flag", 1)


def write_dat(path: Path, arrays: ProblemArrays, storage: str = "blocks") -> None:
    """Write a problem; numbers have 17 digits, so that reading gives the same float64 again.

    Parameters
    ----------
    path : where to write; an existing file is replaced in one step.
    arrays : a reduced or full problem whose block size is its dimension, without bilateral rows, stored solution or
        guesses; a dilatancy in reduced problems only. It is written as mu - zeta, which may cost it its last bit.
    storage : "blocks" (only blocks with a non-zero, s by s, or of one row where the rows are not a multiple of s) or "dense".

    Raises
    ------
    InputError : a problem the format has no place for, inconsistent arrays, unknown storage, or a place that
        cannot be written.
    """
    require_sound(arrays, str(path))
    if arrays.C is not None or arrays.P is not None:
        raise InputError(
            str(path), "a problem with bilateral rows", "written to .hdf5, .dat has no place for them"
        )
    if arrays.dilatancy is not None and not arrays.reduced:
        raise InputError(
            f"{path}: dilatancy", "given", "absent, .dat has a place for it in reduced problems only"
        )
    if arrays.block_size != arrays.dimension:
        raise InputError(f"{path}: block size", arrays.block_size, "the dimension, for .dat")
    if arrays.solution is not None or arrays.guesses:
        raise InputError(
            str(path), "a problem with solution or guesses", "written to .hdf5, .dat has no place for them"
        )
    if storage not in ("blocks", "dense"):
        raise InputError("storage", storage, "'blocks' or 'dense'")
    matrices = [arrays.W] if arrays.M is None or arrays.H is None else [arrays.M, sp.csr_array(arrays.H.T)]
    vectors = [arrays.b, arrays.mu] if arrays.reduced else [arrays.f, arrays.w, arrays.mu]
    lines = [str(arrays.dimension), str(arrays.count)]
    for matrix in matrices:
        lines += _matrix_lines(matrix, arrays.block_size, storage)
    lines += [_row(vector) for vector in vectors if vector is not None]
    if arrays.dilatancy is not None:
        lines.append(_row(arrays.mu - arrays.dilatancy))
    with replacing(path) as draft:
        draft.write_text("\n".join(lines) + "\n", encoding="ascii")


def _matrix_lines(matrix: sp.csr_array, s: int, storage: str) -> list[str]:
    head = ["1" if storage == "blocks" else "0", *map(str, matrix.shape)]
    if storage == "dense":
        return [*head, f"{matrix.shape[0]}\t{matrix.shape[1]}", *map(_row, matrix.toarray().T)]
    return [*head, *_block_lines(matrix, *(s if size % s == 0 else 1 for size in matrix.shape))]


def _block_lines(matrix: sp.csr_array, height: int, width: int) -> list[str]:
    if not matrix.nnz:
        return ["0"]
    blocks = sp.bsr_array(matrix, blocksize=(height, width))
    blocks.sort_indices()
    rows, columns, count = matrix.shape[0] // height, matrix.shape[1] // width, len(blocks.data)
    ends = [_row(height * np.arange(1, rows + 1)), _row(width * np.arange(1, columns + 1))]
    lines = [str(count), str(rows), str(columns), *ends, str(rows + 1), str(count)]
    lines += [_row(blocks.indptr), _row(blocks.indices)]
    for number, block in enumerate(blocks.data):
        lines += [str(number), _row(block.ravel(order="F"))]
    return lines


def _row(values: NDArray[Any]) -> str:
    form = "d" if values.dtype.kind == "i" else ".16e"
    return "\t".join(format(value, form) for value in values.tolist())
