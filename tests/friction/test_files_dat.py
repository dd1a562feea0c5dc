"""Token files `.dat`: every bit of every number survives, in both storages, for reduced and full problems."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from stored_problems import assert_same, made_up, made_up_full

from barchan.cones import DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, read, solve, write
from barchan.friction.files import ProblemArrays, read_arrays, write_arrays


@pytest.mark.parametrize("s", [2, 3])
@pytest.mark.parametrize(("name", "storage"), [("p.dat", "blocks"), ("p.dat", "dense"), ("p.h5", "blocks")])
def test_reduced_problems_survive_bit_by_bit(tmp_path: Path, name: str, storage: str, s: int) -> None:
    arrays = made_up(s=s)
    write_arrays(tmp_path / name, arrays, storage)
    assert_same(read_arrays(tmp_path / name), arrays)


@pytest.mark.parametrize("storage", ["blocks", "dense"])
@pytest.mark.parametrize("m", [6, 7, 9])
@pytest.mark.parametrize("s", [2, 3])
def test_full_problems_survive_bit_by_bit(tmp_path: Path, storage: str, s: int, m: int) -> None:
    """Also where M has as many rows as the contacts (m = n s), and where m is no multiple of s."""
    arrays = replace(made_up_full(n=3, s=s, m=m), C=None, k=None, solution=None, guesses=())
    bare = replace(arrays, title="", description="")
    write_arrays(tmp_path / "full.dat", bare, storage)
    assert_same(read_arrays(tmp_path / "full.dat"), bare)


@pytest.mark.parametrize("name", ["none.dat", "none.hdf5"])
def test_no_contact_is_a_problem_too(tmp_path: Path, name: str) -> None:
    reduced = ProblemArrays(3, 3, np.zeros(0), W=sp.csr_array((0, 0)), b=np.zeros(0))
    full = {"M": sp.csr_array(np.eye(2)), "f": np.ones(2), "H": sp.csr_array((0, 2)), "w": np.zeros(0)}
    for arrays in (reduced, ProblemArrays(3, 3, np.zeros(0), **full)):
        write_arrays(tmp_path / name, arrays)
        assert_same(read_arrays(tmp_path / name), arrays)
        assert solve(read(tmp_path / name)).converged


@pytest.mark.parametrize("storage", ["blocks", "dense"])
def test_a_zero_delassus_operator_survives(tmp_path: Path, storage: str) -> None:
    arrays = replace(made_up(), W=sp.csr_array((12, 12)))
    write_arrays(tmp_path / "zero.dat", arrays, storage)
    assert_same(read_arrays(tmp_path / "zero.dat"), arrays)


def test_a_global_token_file(tmp_path: Path) -> None:
    """M in two blocks of unlike sizes, H with an empty block row, f, w, mu and the final flag."""
    text = """2 1
        1 3 3   2  2 2  2 3  2 3   3 2  0 1 2  0 1   0 4 1 1 5   1 7
        1 3 2   1  2 1  2 3  2     2 1  0 1    0     0 11 21 12 22
        0.5 0.25 0.125   -1 -2   0.75 1"""
    path = tmp_path / "global.dat"
    path.write_text(text)
    arrays = read_arrays(path)
    np.testing.assert_array_equal(arrays.M.toarray(), [[4, 1, 0], [1, 5, 0], [0, 0, 7]])
    np.testing.assert_array_equal(arrays.H.toarray(), [[11, 21, 0], [12, 22, 0]])
    for ours, value in ((arrays.f, [0.5, 0.25, 0.125]), (arrays.w, [-1, -2]), (arrays.mu, [0.75])):
        np.testing.assert_array_equal(ours, value)


def test_a_global_file_whose_mass_matrix_has_the_size_of_the_contacts(tmp_path: Path) -> None:
    path = tmp_path / "global.dat"
    path.write_text("2 1  0 2 2  2 2  4 1 1 5   0 2 2  2 2  1 2 3 4   0.5 0.25  -1 -2  0.75")
    arrays = read_arrays(path)
    np.testing.assert_array_equal(arrays.H.toarray(), [[1, 2], [3, 4]])
    np.testing.assert_array_equal(arrays.w, [-1, -2])


TRIPLETS = "CSparse Version 4.0.2, Jan 2012.  Copyright (c) X\ntriplet: 2-by-2, nzmax: 9 nnz: 3\n"
TRIPLETS += "0 0 : 4\n 1 0 : 1\n 1 1 : 5\n"
COLUMNS = "CSparse Version 4.0.2, Jan 2012.  Copyright (c) X\n2-by-2, nzmax: 3 nnz: 2, 1-norm: 5\n"
COLUMNS += "    col 0 : locations 0 to 1\n      0 : 4\n      1 : 1\n"
COLUMNS += "    col 1 : locations 2 to 1\n"


@pytest.mark.parametrize(
    ("printed", "matrix"),
    [
        ("1\n" + TRIPLETS, [[4, 0], [1, 5]]),
        (TRIPLETS, [[4, 0], [1, 5]]),
        ("2\n" + COLUMNS, [[4, 0], [1, 0]]),
    ],
)
def test_printed_sparse_matrices(tmp_path: Path, printed: str, matrix: list[list[float]]) -> None:
    path = tmp_path / "printed.dat"
    path.write_text(f"2\n1\n2\n2\n2\n{printed} 0.5 -0.5\n 0.75\n")
    arrays = read_arrays(path)
    np.testing.assert_array_equal(arrays.W.toarray(), matrix)
    np.testing.assert_array_equal(arrays.b, [0.5, -0.5])


def test_the_second_row_of_coefficients_is_the_shift_of_a_plastic_law(tmp_path: Path) -> None:
    """theta |u_T| = (mu - zeta) |u_T|; theta = mu is Coulomb's law."""
    path = tmp_path / "plastic.dat"
    arrays = replace(made_up(n=2), mu=np.array([0.5, 0.75]), dilatancy=np.array([0.25, 0.0]))
    write_arrays(path, arrays)
    assert list(map(float, path.read_text().split()[-2:])) == [0.25, 0.75]
    assert_same(read_arrays(path), arrays)
    write_arrays(path, replace(arrays, dilatancy=np.zeros(2)))
    assert read_arrays(path).dilatancy is None


def dat_text(**changes: str) -> str:
    """A small sound reduced file in storage 1, with parts replaced."""
    parts = {
        "head": "2 2 1 4 4",
        "blocks": "2 2 2  2 4  2 4  3 2  0 1 2  0 1",
        "values": "0 1 0 0 1  1 2 0 0 2",
        "q": "-1 0 -1 0",
        "mu": "0.5 0.5",
    }
    return "\n".join({**parts, **changes}.values())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mu": "0.5"}, "truncated"),
        ({"q": "", "mu": ""}, "truncated"),
        ({"values": "0 1 0 0 1  1 2 0 0"}, "tokens left|whole|must be"),
        ({"values": "0 1 0 0 1  7 2 0 0 2"}, "block 1 of the first matrix = number 7"),
        ({"values": "0 1 0 0 nan  1 2 0 0 2"}, "finite"),
        ({"q": "-1 0 inf 0"}, r"q\[2\] = inf: must be finite"),
        ({"mu": "0.5 -0.5"}, r"mu\[1\] = -0.5: must be >= 0"),
        ({"mu": "0.5 half"}, "mu = half: must be numbers"),
        ({"head": "4 2 1 4 4"}, "dimension = 4: must be 2 or 3"),
        ({"head": "2 2 7 4 4"}, "storage type of the first matrix = 7"),
        ({"head": "2 -2 1 4 4"}, "number of contacts = -2"),
        ({"head": "2 99999999999999999999 1 4 4"}, "number of contacts"),
        ({"head": "2 2 1 4 6"}, "column sizes of the first matrix"),
        ({"blocks": "2 2 2  2 4  2 4  3 2  0 1 2  0 5"}, "block columns"),
        ({"blocks": "2 2 2  2 4  2 4  3 2  0 2 1  0 1"}, "row pointers"),
        ({"mu": "0.5 0.5 0.1 0.1 1 1 1 1"}, "storage type of H|must be"),
        ({"mu": "0.5 5.0e-0"}, "last number = 5.0e-0: must be whole"),
        ({"mu": "5.0e-01 5.0"}, "last number = 5.0: must be whole"),
        ({"head": "2 2 1 2000000000 2000000000"}, "no larger than the file"),
        ({"head": "2 1000000000 0 2000000000 2000000000"}, "no larger than the file"),
        ({"head": "2 2 2 4 4", "blocks": "9" * 5000 + "-by-4, nzmax: 1 nnz: 0,"}, "line of sizes"),
        ({"blocks": "2000000000 2 2  2 4  2 4  3 2  0 1 2000000000  0 1"}, "block columns"),
    ],
)
def test_unsound_token_files_are_refused_by_name(tmp_path: Path, changes: dict[str, str], says: str) -> None:
    path = tmp_path / "bad.dat"
    path.write_text(dat_text(**changes))
    with pytest.raises(InputError, match=says) as caught:
        read_arrays(path)
    assert "bad.dat" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_small_file_is_sound_as_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "good.dat"
    path.write_text(dat_text())
    np.testing.assert_array_equal(read_arrays(path).W.toarray(), np.diag([1.0, 1.0, 2.0, 2.0]))


def test_a_dilatant_law_goes_into_a_token_file_and_a_yield_stress_nowhere(tmp_path: Path) -> None:
    arrays = made_up(n=2)
    for law in (DruckerPrager(np.array([0.5, 0.75]), dilatancy=0.25), SecondOrderCone(np.array([0.5, 0.3]))):
        problem = Problem.reduced(W=arrays.W, b=arrays.b, law=law)
        write(tmp_path / "p.dat", problem)
        np.testing.assert_array_equal(read(tmp_path / "p.dat").parameters, problem.parameters)
        with pytest.raises(InputError, match="dilatancy"):
            write(tmp_path / "p.hdf5", problem)
    soil = Problem.reduced(W=arrays.W, b=arrays.b, law=DruckerPrager(np.array([0.5, 0.75]), shear_yield=0.1))
    for name in ("q.dat", "q.hdf5"):
        with pytest.raises(InputError, match="without yield stresses"):
            write(tmp_path / name, soil)


def reserved(call: Callable[[], object]) -> int:
    """Bytes at the peak of what a call allocates."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_forged_sizes_reserve_no_memory(tmp_path: Path) -> None:
    """Every size and index of a small file replaced by the largest one."""
    path = tmp_path / "forged.dat"
    tokens = dat_text().split()
    for place in range(len(dat_text(values="", q="", mu="").split())):
        path.write_text(" ".join([*tokens[:place], "2147483647", *tokens[place + 1 :]]))
        assert reserved(lambda: read_arrays(path)) < 1e6
