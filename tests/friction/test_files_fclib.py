"""FCLIB files: signs, matrix forms, bilateral rows, solutions and guesses; what is unsound is refused by name."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from stored_problems import assert_same, made_up_full

from barchan.errors import InputError
from barchan.friction import read, solve
from barchan.friction.files import ProblemArrays, SolutionArrays, read_arrays, write_arrays


def test_full_problems_survive_with_bilateral_rows_solution_and_guesses(tmp_path: Path) -> None:
    arrays = made_up_full()
    write_arrays(tmp_path / "full.hdf5", arrays)
    assert_same(read_arrays(tmp_path / "full.hdf5"), arrays)


def test_fclib_signs_of_bilateral_rows(tmp_path: Path) -> None:
    """FCLIB: M v = H r + G l + f and G^T v + b = 0; ours: M v = f + H^T r + C^T l and C v = k."""
    arrays = made_up_full()
    write_arrays(tmp_path / "full.hdf5", arrays)
    with h5py.File(tmp_path / "full.hdf5") as file:
        for name, ours in (("H", arrays.H), ("G", arrays.C)):
            stored = file[f"fclib_global/{name}"]
            theirs = np.zeros((stored["m"][0], stored["n"][0]))
            theirs[stored["i"][:], stored["p"][:]] = stored["x"][:]
            np.testing.assert_array_equal(theirs, ours.toarray().T)
        np.testing.assert_array_equal(file["fclib_global/vectors/b"], -arrays.k)


@pytest.mark.parametrize("form", ["rows", "columns", "triplets", "swapped triplets"])
def test_every_matrix_form_of_fclib_gives_the_same_matrix(tmp_path: Path, form: str) -> None:
    """Triplets with repeated entries add up; indices in FCLIB's documented order are told by the shape."""
    path = tmp_path / "full.hdf5"
    arrays = replace(made_up_full(), solution=None, guesses=())
    write_arrays(path, arrays)
    theirs = sp.csr_array(arrays.H.T)
    with h5py.File(path, "a") as file:
        group = file["fclib_global/H"]
        for name in ("nz", "p", "i", "x"):
            del group[name]
        if form in ("rows", "columns"):
            stored = theirs if form == "rows" else theirs.tocsc()
            values = {
                "nz": -2 if form == "rows" else -1,
                "p": stored.indptr,
                "i": stored.indices,
                "x": stored.data,
            }
        else:
            row, column = theirs.tocoo().coords
            row, column = (column, row) if form.startswith("swapped") else (row, column)
            halves = np.tile(theirs.data / 2.0, 2)
            values = {"nz": 2 * theirs.nnz, "i": np.tile(row, 2), "p": np.tile(column, 2), "x": halves}
        for name, value in values.items():
            group[name] = np.atleast_1d(value)
    assert_same(read_arrays(path), arrays)


def remove(item: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(item)


def put(item: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        if item in file:
            del file[item]
        file[item] = value

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (remove("fclib_global"), "fclib_local or fclib_global"),
        (remove("fclib_global/M"), "fclib_global/M/m = missing"),
        (remove("fclib_global/vectors/mu"), "vectors/mu = missing"),
        (put("fclib_global/vectors/mu", "soft"), "vectors/mu = not numbers"),
        (put("fclib_global/vectors/mu", np.array([0.1, np.nan, 0.1])), r"mu\[1\] = nan"),
        (put("fclib_global/vectors/mu", np.array([0.1, 0.1])), "shape of H"),
        (put("fclib_global/vectors/f", np.zeros(3)), "shape of f"),
        (put("fclib_global/vectors/w", np.full(9, np.inf)), "finite"),
        (put("fclib_global/spacedim", [7]), "dimension = 7"),
        (put("fclib_global/spacedim", [3, 3]), "one number"),
        (put("fclib_global/H/i", np.array([99])), "H/i, p, x"),
        (put("fclib_global/M/nz", [-7]), "nz >= -2"),
        (put("fclib_global/M/nz", [-2]), "M/p = inconsistent"),
        (put("fclib_global/M/p", np.full(7, 99)), "indices of a matrix of shape"),
        (put("solution/r", np.zeros(4)), "solution: shape of r"),
        (put("guesses/number_of_guesses", [3]), "guesses/3/r = missing"),
        (remove("fclib_global/vectors/b"), "vectors/b = missing"),
    ],
)
def test_unsound_fclib_files_are_refused_by_name(
    tmp_path: Path, change: Callable[[h5py.File], None], says: str
) -> None:
    path = tmp_path / "bad.hdf5"
    write_arrays(path, made_up_full())
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(InputError, match=says) as caught:
        read_arrays(path)
    assert "bad.hdf5" in str(caught.value)


def mixed(full: ProblemArrays) -> ProblemArrays:
    """The full problem with its velocities eliminated and its bilateral multipliers kept (seed B, Eq. 2.18)."""
    inverse = np.linalg.inv(full.M.toarray())
    H, C = full.H.toarray(), full.C.toarray()
    return ProblemArrays(
        full.dimension,
        full.block_size,
        full.mu,
        W=sp.csr_array(H @ inverse @ H.T),
        b=H @ (inverse @ full.f) + full.w,
        B=sp.csr_array(H @ inverse @ C.T),
        P=sp.csr_array(C @ inverse @ C.T),
        c=C @ (inverse @ full.f) - full.k,
    )


def test_mixed_local_problems_survive_with_their_multipliers(tmp_path: Path) -> None:
    """FCLIB: u = W r + V l + q and V^T r + R l + s = 0."""
    arrays = mixed(made_up_full())
    state = SolutionArrays(np.arange(9.0), np.ones(9), l=np.array([1.0, 2.0]))
    arrays = replace(arrays, solution=state, guesses=(state,))
    write_arrays(tmp_path / "mixed.hdf5", arrays)
    assert_same(read_arrays(tmp_path / "mixed.hdf5"), arrays)
    with h5py.File(tmp_path / "mixed.hdf5") as file:
        np.testing.assert_array_equal(file["fclib_local/vectors/s"], arrays.c)
        assert {"W", "V", "R"} <= set(file["fclib_local"])
    with pytest.raises(InputError, match="bilateral rows"):
        write_arrays(tmp_path / "mixed.dat", replace(arrays, solution=None, guesses=()))


def test_a_mixed_problem_and_the_full_one_behind_it_have_the_same_solution(tmp_path: Path) -> None:
    full = replace(made_up_full(), solution=None, guesses=())
    write_arrays(tmp_path / "full.hdf5", full)
    write_arrays(tmp_path / "mixed.hdf5", mixed(full))
    one, other = (solve(read(tmp_path / name), tol=1e-10) for name in ("full.hdf5", "mixed.hdf5"))
    assert one.converged and other.converged
    np.testing.assert_allclose(one.u, other.u, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (remove("fclib_local/V"), "V/m = missing"),
        (remove("fclib_local/R"), "R/m = missing"),
        (remove("fclib_local/vectors/s"), "vectors/s = missing"),
        (put("fclib_local/vectors/s", np.zeros(5)), "shape of B"),
        (put("fclib_local/R/x", np.zeros(4)), "R .our P. = singular"),
    ],
)
def test_unsound_mixed_problems_are_refused_by_name(
    tmp_path: Path, change: Callable[[h5py.File], None], says: str
) -> None:
    path = tmp_path / "bad.hdf5"
    write_arrays(path, mixed(made_up_full()))
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(InputError, match=says):
        read(path)


def huge(item: str) -> Callable[[h5py.File], None]:
    """A dataset that claims 2^40 numbers and stores none."""

    def change(file: h5py.File) -> None:
        kind = file[item].dtype
        del file[item]
        file.create_dataset(item, shape=(2**40,), dtype=kind, chunks=(1024,))

    return change


@pytest.mark.parametrize(
    "change",
    [
        huge("fclib_global/vectors/mu"),
        huge("fclib_global/M/x"),
        huge("fclib_global/H/i"),
        huge("solution/v"),
        put("fclib_global/M/m", [2_000_000_000]),
        put("fclib_global/H/n", [2_000_000_000]),
        put("fclib_global/G/m", [2_000_000_000]),
        put("fclib_global/M/nz", [2_000_000_000]),
        put("guesses/number_of_guesses", [2_000_000_000]),
        put("fclib_global/M/p", np.full(7, 0.5)),
        put("fclib_global/M/m", [np.nan]),
    ],
)
def test_forged_sizes_are_refused_and_reserve_no_memory(
    tmp_path: Path, change: Callable[[h5py.File], None]
) -> None:
    path = tmp_path / "forged.hdf5"
    write_arrays(path, made_up_full())
    with h5py.File(path, "a") as file:
        change(file)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"forged\.hdf5"):
            read_arrays(path)
        assert tracemalloc.get_traced_memory()[1] < 1e7
    finally:
        tracemalloc.stop()
