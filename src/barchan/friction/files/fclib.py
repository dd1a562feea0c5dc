"""FCLIB's HDF5 files: local (reduced or mixed) and global frictional contact problems, solutions and guesses.

FCLIB writes M v = H r + G l + f, G^T v + b = 0, u = H^T v + w and u = W r + V l + q, V^T r + R l + s = 0 (seed B, discussion
of chapter 4). In the signs of DESIGN and Eq. 2.18 its H, G, b are our H^T, C^T, -k; its q, V, R, s our b, B, P, c.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction.files.arrays import ProblemArrays, SolutionArrays, Vector, canonical, require_sound
from barchan.storage import replacing

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_CSC, _CSR = -1, -2
_LARGEST = 2**31 - 1
# Deflate, the strongest filter that FCLIB's writers use, shrinks at most 1032 times.
_STRONGEST_COMPRESSION = 1032
_ALWAYS_READ = 2**20
_LARGEST_CHUNK = 2**28
# What h5py raises for a file whose structure is broken, depending on where the damage lies.
_DAMAGE = (OSError, RuntimeError, KeyError, TypeError, ValueError)


def is_hdf5(path: Path) -> bool:
    """Whether the file at `path` starts with the HDF5 signature."""
    with path.open("rb") as file:
        return file.read(len(_SIGNATURE)) == _SIGNATURE


def read_fclib(path: Path) -> ProblemArrays:
    """Read an FCLIB file with its solution and guesses, where present.

    Raises
    ------
    InputError : not an FCLIB file, missing or misshapen items, numbers that are not finite. No more memory is taken than
        the file can fill, whatever sizes it claims.
    """
    try:
        with h5py.File(path, "r") as file:
            arrays = _read_problem(_Items(str(path), file))
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(str(path), "truncated or damaged HDF5", "a complete FCLIB file") from error
    require_sound(arrays, str(path))
    return arrays


@dataclass(frozen=True)
class _Items:
    """Takes items out of an open file; what is missing or misshapen is an InputError naming file and item."""

    source: str
    file: h5py.File

    def wrong(self, item: str, value: object, allowed: str) -> InputError:
        return InputError(f"{self.source}: {item}", value, allowed)

    def has(self, item: str) -> bool:
        return item in self.file

    def numbers(self, item: str, kind: type[np.float64] | type[np.int64]) -> Any:
        """All numbers of a dataset, flat."""
        dataset = self.file.get(item)
        if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "iuf":
            raise self.wrong(item, "missing" if dataset is None else "not numbers", "a dataset of numbers")
        values = np.asarray(self._content(item, dataset)).ravel()
        if kind is np.int64 and not np.array_equal(values, np.trunc(values)):
            raise self.wrong(item, "fractions", "whole numbers")
        return values.astype(kind)

    def _content(self, item: str, dataset: h5py.Dataset) -> Any:
        """What a dataset holds, provided that the file is large enough to hold it."""
        claimed = dataset.size * dataset.dtype.itemsize
        chunk = int(np.prod(dataset.chunks or (0,), dtype=float)) * dataset.dtype.itemsize
        stored = _STRONGEST_COMPRESSION * min(dataset.id.get_storage_size(), Path(self.source).stat().st_size)
        if claimed > max(stored, _ALWAYS_READ) or chunk > _LARGEST_CHUNK:
            raise self.wrong(item, f"{claimed} bytes", "what the file can hold")
        return dataset[()]

    def vector(self, item: str) -> Vector:
        vector: Vector = self.numbers(item, np.float64)
        return vector

    def integer(self, item: str) -> int:
        values = self.numbers(item, np.int64)
        if len(values) != 1:
            raise self.wrong(item, f"{len(values)} numbers", "one number")
        return int(values[0])

    def text(self, item: str) -> str:
        dataset = self.file.get(item)
        scalar = isinstance(dataset, h5py.Dataset) and dataset.shape == ()
        value = self._content(item, dataset) if scalar else b""
        return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)

    def matrix(self, item: str, largest: int) -> sp.csr_array:
        """A matrix in compressed rows (nz = -2), compressed columns (nz = -1) or nz triplets; at most `largest` rows, columns.

        In triplets `i` holds the rows and `p` the columns, as CSparse and every file seen have it; FCLIB's
        own documentation says the opposite, so the other order is taken when only that one fits the shape.
        """
        shape = self.integer(f"{item}/m"), self.integer(f"{item}/n")
        nz = self.integer(f"{item}/nz")
        i, p = self.numbers(f"{item}/i", np.int64), self.numbers(f"{item}/p", np.int64)
        x = self.vector(f"{item}/x")
        if min(shape) < 0 or nz < _CSR:
            raise self.wrong(f"{item}/m, n, nz", (*shape, nz), "sizes >= 0 and nz >= -2")
        if max(shape) > largest:
            raise self.wrong(f"{item}/m, n", shape, f"at most {largest}, the length of the longest vector")
        if nz >= 0:
            return self._from_triplets(item, shape, (i[:nz], p[:nz], x[:nz]), nz)
        lines, across = shape if nz == _CSR else shape[::-1]
        steps = np.diff(p)
        if len(p) != lines + 1 or p[0] != 0 or np.any(steps < 0) or p[-1] > min(len(i), len(x)):
            raise self.wrong(
                f"{item}/p", "inconsistent", f"{lines + 1} numbers growing from 0 to the number of entries"
            )
        line, other, x = np.repeat(np.arange(lines), steps), i[: p[-1]], x[: p[-1]]
        if len(other) and (other.min() < 0 or other.max() >= across):
            raise self.wrong(f"{item}/i", f"{other.min()} to {other.max()}", f"from 0 to {across - 1}")
        entries = (line, other) if nz == _CSR else (other, line)
        return canonical(sp.coo_array((x, entries), shape=shape))

    def _from_triplets(
        self, item: str, shape: tuple[int, int], triplets: tuple[Any, Any, Vector], nz: int
    ) -> sp.csr_array:
        i, p, x = triplets
        if not len(i) == len(p) == len(x) == nz:
            raise self.wrong(f"{item}/i, p, x", (len(i), len(p), len(x)), f"at least nz = {nz} entries each")
        for row, column in ((i, p), (p, i)):
            if nz == 0 or (min(i.min(), p.min()) >= 0 and row.max() < shape[0] and column.max() < shape[1]):
                return canonical(sp.coo_array((x, (row, column)), shape=shape))
        raise self.wrong(
            f"{item}/i, p", f"up to ({i.max()}, {p.max()})", f"indices of a matrix of shape {shape}"
        )


def _read_problem(items: _Items) -> ProblemArrays:
    roots = [root for root in ("fclib_local", "fclib_global") if items.has(root)]
    if len(roots) != 1:
        found = ", ".join(map(str, list(items.file)[:4])) or "nothing"
        raise items.wrong("groups", found, "fclib_local or fclib_global")
    root = roots[0]
    dimension = items.integer(f"{root}/spacedim")
    parts: dict[str, Any] = {"mu": items.vector(f"{root}/vectors/mu")}
    parts |= {name: items.text(f"{root}/info/{name}") for name in ("title", "description", "math_info")}
    parts |= _read_local(items, root) if root == "fclib_local" else _read_global(items, root)
    if items.has("solution"):
        parts["solution"] = _read_state(items, "solution")
    if items.has("guesses"):
        count = items.integer("guesses/number_of_guesses")
        parts["guesses"] = tuple(_read_state(items, f"guesses/{number + 1}") for number in range(count))
    return ProblemArrays(dimension, dimension, **parts)


def _read_local(items: _Items, root: str) -> dict[str, Any]:
    parts: dict[str, Any] = {"b": items.vector(f"{root}/vectors/q")}
    if any(items.has(f"{root}/{name}") for name in ("V", "R")):
        parts["c"] = items.vector(f"{root}/vectors/s")
    largest = max(map(len, parts.values()))
    parts["W"] = items.matrix(f"{root}/W", largest)
    if "c" in parts:
        parts |= {"B": items.matrix(f"{root}/V", largest), "P": items.matrix(f"{root}/R", largest)}
    return parts


def _read_global(items: _Items, root: str) -> dict[str, Any]:
    parts: dict[str, Any] = {name: items.vector(f"{root}/vectors/{name}") for name in "fw"}
    if items.has(f"{root}/G"):
        parts["k"] = 0.0 - items.vector(f"{root}/vectors/b")  # from 0, so that a zero does not become -0
    largest = max(map(len, parts.values()))
    parts |= {"M": items.matrix(f"{root}/M", largest), "H": canonical(items.matrix(f"{root}/H", largest).T)}
    if "k" in parts:
        parts["C"] = canonical(items.matrix(f"{root}/G", largest).T)
    return parts


def _read_state(items: _Items, group: str) -> SolutionArrays:
    optional = {name: items.vector(f"{group}/{name}") for name in ("v", "l") if items.has(f"{group}/{name}")}
    return SolutionArrays(items.vector(f"{group}/r"), items.vector(f"{group}/u"), **optional)


def write_fclib(path: Path, arrays: ProblemArrays) -> None:
    """Write an FCLIB file, with W by compressed rows or M, H and G as triplets.

    Siconos reads compressed rows in local files only; triplets are what it writes and reads in global ones.

    Parameters
    ----------
    path : where to write; an existing file is replaced in one step.
    arrays : a problem whose block size is its dimension, without dilatancy.

    Raises
    ------
    InputError : a problem the format has no place for, inconsistent arrays, or a place that cannot be
        written.
    """
    require_sound(arrays, str(path))
    if arrays.block_size != arrays.dimension:
        raise InputError(
            f"{path}: block size", arrays.block_size, f"the dimension {arrays.dimension}, for FCLIB"
        )
    if arrays.dilatancy is not None:
        raise InputError(f"{path}: dilatancy", "given", "absent, FCLIB has no place for it")
    with replacing(path) as draft, h5py.File(draft, "w") as file:
        _write_problem(file, arrays)
        if arrays.solution is not None:
            _write_state(file, "solution", arrays.solution)
        if arrays.guesses:
            _write_integers(file, "guesses/number_of_guesses", [len(arrays.guesses)])
            for number, guess in enumerate(arrays.guesses):
                _write_state(file, f"guesses/{number + 1}", guess)


def _write_problem(file: h5py.File, arrays: ProblemArrays) -> None:
    root = "fclib_local" if arrays.reduced else "fclib_global"
    _write_integers(file, f"{root}/spacedim", [arrays.dimension])
    for name, matrix in (("W", arrays.W), ("V", arrays.B), ("R", arrays.P)):
        if matrix is not None:
            _write_matrix(file, f"{root}/{name}", matrix, compressed=True)
    for name, matrix in (("M", arrays.M), ("H", arrays.H), ("G", arrays.C)):
        if matrix is not None:
            _write_matrix(file, f"{root}/{name}", matrix if name == "M" else matrix.T)
    opposite_k = None if arrays.k is None else 0.0 - arrays.k
    vectors = {"mu": arrays.mu, "q": arrays.b, "f": arrays.f, "w": arrays.w, "b": opposite_k, "s": arrays.c}
    for name, vector in vectors.items():
        if vector is not None:
            file.create_dataset(f"{root}/vectors/{name}", data=vector)
    for name in ("title", "description", "math_info"):
        _write_text(file, f"{root}/info/{name}", getattr(arrays, name))


def _write_matrix(file: h5py.File, group: str, matrix: sp.sparray, compressed: bool = False) -> None:
    rows = canonical(matrix)
    if compressed:
        nz, i, p = _CSR, rows.indices, rows.indptr
    else:
        i, p = rows.tocoo().coords
        nz = rows.nnz
    for name, value in (("nzmax", rows.nnz), ("m", rows.shape[0]), ("n", rows.shape[1]), ("nz", nz)):
        _write_integers(file, f"{group}/{name}", [value])
    _write_integers(file, f"{group}/p", p)
    _write_integers(file, f"{group}/i", i)
    file.create_dataset(f"{group}/x", data=rows.data)


def _write_integers(file: h5py.File, name: str, values: Any) -> None:
    numbers = np.asarray(values)
    if numbers.size and numbers.max() > _LARGEST:
        raise InputError(f"{file.filename}: {name}", int(numbers.max()), f"at most {_LARGEST} in FCLIB")
    file.create_dataset(name, data=numbers.astype(np.int32))


def _write_text(file: h5py.File, name: str, text: str) -> None:
    """A scalar string of fixed length that ends in a zero byte, as the HDF5 C library writes it."""
    raw = text.encode("utf-8") + b"\0"
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(len(raw))
    space = h5py.h5s.create(h5py.h5s.SCALAR)
    links = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    links.set_create_intermediate_group(True)
    dataset = h5py.h5d.create(file.id, name.encode(), kind, space, lcpl=links)
    dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.array(raw, dtype=f"S{len(raw)}"), mtype=kind)


def _write_state(file: h5py.File, group: str, state: SolutionArrays) -> None:
    for name in ("v", "u", "r", "l"):
        vector = getattr(state, name)
        if vector is not None:
            file.create_dataset(f"{group}/{name}", data=vector)
