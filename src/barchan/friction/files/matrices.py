"""Matrices inside token files: the three storages of Siconos' text files, read into canonical CSR.

Each starts with "storage type, rows, columns". Storage 0: rows and columns again, then the values column by
column. Storage 1: sparse blocks (`_read_blocks`). Storage 2: a sparse matrix as CSparse prints it
(`_read_printed`).
"""

from __future__ import annotations

import re
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from barchan.friction.files.arrays import Vector, canonical
from barchan.friction.files.tokens import Integers, TokenReader

_ORIGINS = (1, 2)
_COLUMN_HEADING = 7


def read_matrix(reader: TokenReader, name: str) -> sp.csr_array:
    """Read the matrix that starts at the next token.

    Parameters
    ----------
    reader : the tokens; left after the last one of the matrix.
    name : what to call the matrix in messages.

    Raises
    ------
    InputError : unknown storage, truncated or inconsistent sizes, or entries that are not finite. Nothing larger than a
        few times the file is ever allocated, whatever sizes it claims.
    """
    storage = reader.integer(f"storage type of {name}")
    rows, columns = reader.integers(f"shape of {name}", 2)
    if storage not in (0, 1, 2):
        raise reader.wrong(f"storage type of {name}", storage, "0 (dense), 1 (sparse blocks) or 2 (printed)")
    # Rows and columns of every matrix of a problem are also the length of one of its vectors.
    if max(rows, columns) > len(reader.tokens):
        raise reader.wrong(
            f"shape of {name}", f"({rows}, {columns})", "no larger than the file (is it truncated?)"
        )
    return (_read_dense, _read_blocks, _read_printed)[storage](reader, name, (int(rows), int(columns)))


def _read_dense(reader: TokenReader, name: str, shape: tuple[int, int]) -> sp.csr_array:
    repeated = tuple(int(size) for size in reader.integers(f"repeated shape of {name}", 2))
    if repeated != shape:
        raise reader.wrong(f"repeated shape of {name}", repeated, f"{shape}")
    values = reader.reals(f"values of {name}", shape[0] * shape[1])
    return canonical(values.reshape(shape, order="F"))


def _read_blocks(reader: TokenReader, name: str, shape: tuple[int, int]) -> sp.csr_array:
    """Number of blocks (nothing follows a 0), block rows, block columns, cumulative row and column sizes,
    lengths of the two index lists, row pointers, block columns, then per block its number and its values
    column by column.
    """
    count = reader.integer(f"number of blocks of {name}")
    if count == 0:
        return sp.csr_array(shape, dtype=np.float64)
    block_rows, block_columns = (int(size) for size in reader.integers(f"block shape of {name}", 2))
    row_starts = _block_starts(reader, f"row sizes of {name}", block_rows, shape[0])
    column_starts = _block_starts(reader, f"column sizes of {name}", block_columns, shape[1])
    filled = reader.integers(f"index lengths of {name}", 2)
    pointers = reader.integers(f"row pointers of {name}", int(filled[0]))
    # Siconos leaves the pointers of trailing empty rows out.
    sizes = np.diff(pointers)
    monotone = len(sizes) and pointers[0] == 0 and np.all(sizes >= 0) and pointers[-1] == count
    if not monotone or len(sizes) > block_rows:
        raise reader.wrong(f"row pointers of {name}", "inconsistent", f"non-decreasing from 0 to {count}")
    block_column = reader.integers(f"block columns of {name}", int(filled[1]))
    if len(block_column) != count or block_column.max() >= block_columns:
        raise reader.wrong(
            f"block columns of {name}", "inconsistent", f"{count} numbers below {block_columns}"
        )

    block_row = np.repeat(np.arange(len(sizes)), sizes)
    heights, widths = np.diff(row_starts)[block_row], np.diff(column_starts)[block_column]
    areas = heights * widths
    heads = np.concatenate(([0], np.cumsum(1 + areas)))
    values = reader.reals(f"blocks of {name}", int(heads[-1]))
    misplaced = np.flatnonzero(values[heads[:-1]] != np.arange(count))
    if len(misplaced):
        found = f"number {values[heads[misplaced[0]]]:g}"
        raise reader.wrong(f"block {misplaced[0]} of {name}", found, f"number {misplaced[0]}, in order")
    block = np.repeat(np.arange(count), areas)
    within = np.arange(len(block)) - np.repeat(np.cumsum(areas) - areas, areas)
    row = row_starts[block_row[block]] + within % heights[block]
    column = column_starts[block_column[block]] + within // heights[block]
    return canonical(sp.coo_array((np.delete(values, heads[:-1]), (row, column)), shape=shape))


def _block_starts(reader: TokenReader, item: str, count: int, total: int) -> Integers:
    """First row (or column) of each block and one past the last, (count + 1,), from their cumulative sizes."""
    starts = np.concatenate((np.zeros(1, dtype=np.int64), reader.integers(item, count)))
    if starts[-1] != total or np.any(np.diff(starts) <= 0):
        raise reader.wrong(item, f"ending at {starts[-1]}", f"increasing up to {total}")
    return starts


def _read_printed(reader: TokenReader, name: str, shape: tuple[int, int]) -> sp.csr_array:
    """An origin (1 triplets, 2 columns; absent from older files), a version line, a line of sizes, the entries.

    Triplets: "triplet: m-by-n, nzmax: a nnz: b", then b times "row column : value". Columns: "m-by-n, nzmax:
    a nnz: b, 1-norm: c", then for each column j "col j : locations p to q" and its entries "row : value".
    """
    if reader.remaining and reader.tokens[reader.position].isdigit():
        origin = reader.integer(f"origin of {name}")
        if origin not in _ORIGINS:
            raise reader.wrong(f"origin of {name}", origin, "1 (triplets) or 2 (columns)")
    previous, sizes = b"", None
    while sizes is None:
        (token,) = reader.words(f"line of sizes of {name}", 1)
        sizes = re.fullmatch(rb"(\d{1,10})-by-(\d{1,10}),", token)
        by_triplets = previous == b"triplet:"
        previous = token
    if (int(sizes[1]), int(sizes[2])) != shape:
        raise reader.wrong(
            f"printed shape of {name}", sizes[0].decode().rstrip(","), f"{shape[0]}-by-{shape[1]}"
        )
    announced = reader.words(f"line of sizes of {name}", 4)[3].rstrip(b",")
    count = int(reader.as_integers(f"entries of {name}", [announced])[0])
    if by_triplets:
        row, column, values = _printed_triplets(reader, name, count)
    else:
        reader.words(f"norm of {name}", 2)
        row, column, values = _printed_columns(reader, name, shape[1], count)
    if count and (row.max() >= shape[0] or column.max() >= shape[1]):
        raise reader.wrong(f"indices of {name}", f"({row.max()}, {column.max()})", f"below {shape}")
    return canonical(sp.coo_array((values, (row, column)), shape=shape))


_Entries: TypeAlias = tuple[Integers, Integers, Vector]


def _printed_triplets(reader: TokenReader, name: str, count: int) -> _Entries:
    entries = reader.words(f"entries of {name}", 4 * count)
    row = reader.as_integers(f"rows of {name}", entries[0::4])
    column = reader.as_integers(f"columns of {name}", entries[1::4])
    return row, column, reader.as_reals(f"values of {name}", entries[3::4])


def _printed_columns(reader: TokenReader, name: str, columns: int, count: int) -> _Entries:
    words = reader.words(f"entries of {name}", _COLUMN_HEADING * columns + 3 * count)
    headings = [place for place, word in enumerate(words) if word == b"col"]
    numbers = reader.as_integers(f"column numbers of {name}", [words[place + 1] for place in headings])
    lengths, rest = np.divmod(np.diff([*headings, len(words)]) - _COLUMN_HEADING, 3)
    if not np.array_equal(numbers, np.arange(columns)) or np.any(rest) or np.any(lengths < 0):
        raise reader.wrong(f"columns of {name}", "inconsistent", f"{columns} columns in order")
    entries = [
        word
        for start, length in zip(headings, lengths, strict=True)
        for word in words[start + _COLUMN_HEADING : start + _COLUMN_HEADING + 3 * length]
    ]
    row = reader.as_integers(f"rows of {name}", entries[0::3])
    return row, np.repeat(np.arange(columns), lengths), reader.as_reals(f"values of {name}", entries[2::3])
