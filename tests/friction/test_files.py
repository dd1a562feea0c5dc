"""Problem files say what they say: signs, sizes and every bit of every number survive reading and writing."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction.files import ProblemArrays, SolutionArrays, read_arrays, write_arrays

# name: (full or reduced, number of blocks, block size, largest |W - W^T| / |W| in the file)
STORED = {
    "Box_Stacks-i0122-82-5.hdf5": (True, 82, 3, 1e-14),
    "BoxesStack1-i100000-32.hdf5.dat": (False, 52, 3, 1e-14),
    "Capsules-i100-889.dat": (False, 276, 3, 3e-4),
    "Capsules-i101-404.dat": (False, 225, 3, 3e-4),
    "Capsules-i122-1617.dat": (False, 296, 3, 5e-4),
    "Confeti-ex03-Fc3D-SBM.dat": (False, 54, 3, 1e-14),
    "Confeti-ex13-Fc3D-SBM.dat": (False, 107, 3, 1e-14),
    "FrictionContactProblem00031.dat": (False, 11, 2, 1e-14),
    "FrictionContactProblem00237.dat": (False, 376, 2, 1e-14),
    "GFC3D_OneContact.dat": (True, 1, 3, 1e-14),
    "LMGC_100_PR_PerioBox-i00361-60-03000.hdf5": (False, 60, 3, 1e-14),
    "OneObject-i100000-316.hdf5.dat": (False, 25, 3, 5e-5),
    "RockPile_tob1.dat": (False, 463, 3, 2e-3),
    "plasticity_2d_footing_10.dat": (False, 10, 3, 1e-14),
}


def assert_same(first: ProblemArrays | SolutionArrays, second: ProblemArrays | SolutionArrays) -> None:
    """Equal in every field and every bit."""
    for field in fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if field.name in ("solution", "guesses"):
            pairs = [(a, b)] if field.name == "solution" else list(zip(a, b, strict=True))
            for one, other in pairs:
                assert (one is None) == (other is None)
                if one is not None:
                    assert_same(one, other)
        elif sp.issparse(a):
            assert a.shape == b.shape
            for part in ("data", "indices", "indptr"):
                np.testing.assert_array_equal(getattr(a, part), getattr(b, part), field.name)
        else:
            np.testing.assert_array_equal(a, b, field.name)


def made_up(n: int = 4, s: int = 3, seed: int = 0) -> ProblemArrays:
    """A reduced problem with numbers of all magnitudes and some empty blocks in W."""
    random = np.random.default_rng(seed)
    H = random.standard_normal((n, s, 5)) * 10.0 ** random.integers(-8, 8, (n, s, 1))
    H[1] = 0.0
    H = H.reshape(n * s, 5)
    return ProblemArrays(
        s, s, random.uniform(0.0, 1.5, n), W=sp.csr_array(H @ H.T), b=random.standard_normal(n * s) / 3.0
    )


def made_up_full(n: int = 3, s: int = 3, m: int = 7, bilateral: int = 2) -> ProblemArrays:
    """A full problem with bilateral rows, a solution and two guesses that have nothing to do with it."""
    random = np.random.default_rng(1)

    def state() -> SolutionArrays:
        sizes = {"r": n * s, "u": n * s, "v": m, "l": bilateral}
        return SolutionArrays(**{name: random.standard_normal(size) for name, size in sizes.items()})

    return ProblemArrays(
        s,
        s,
        random.uniform(0.0, 1.0, n),
        M=sp.csr_array(np.diag(random.uniform(1.0, 2.0, m))),
        f=random.standard_normal(m),
        H=sp.random_array((n * s, m), density=0.4, rng=random, format="csr"),
        w=random.standard_normal(n * s),
        C=sp.random_array((bilateral, m), density=0.5, rng=random, format="csr"),
        k=np.array([0.0, -1.5]),
        solution=state(),
        guesses=(state(), state()),
        title="three blocks",
        description="made up, with an é",
        math_info="",
    )


def delassus(arrays: ProblemArrays) -> tuple[np.ndarray, np.ndarray]:
    """Dense W and b of a reduced or full problem without bilateral rows."""
    if arrays.reduced:
        return arrays.W.toarray(), arrays.b
    H = arrays.H.toarray()
    inverse = np.linalg.inv(arrays.M.toarray())
    return H @ inverse @ H.T, H @ (inverse @ arrays.f) + arrays.w


def plain_gauss_seidel(W: np.ndarray, b: np.ndarray, mu: np.ndarray, sweeps: int) -> np.ndarray:
    """Coulomb friction in 3D, one block after the other, by projection on the cone after De Saxce's shift."""
    r = np.zeros_like(b)
    steps = [1.0 / np.linalg.eigvalsh(W[i : i + 3, i : i + 3])[-1] for i in range(0, len(b), 3)]
    for _ in range(sweeps):
        for i, step in enumerate(steps):
            block = slice(3 * i, 3 * i + 3)
            u = W[block] @ r + b[block]
            x = r[block] - step * (u + np.array([mu[i] * np.hypot(u[1], u[2]), 0.0, 0.0]))
            tangential = np.hypot(x[1], x[2])
            if mu[i] * tangential <= -x[0]:
                x[:] = 0.0
            elif tangential > mu[i] * x[0]:
                normal = (x[0] + mu[i] * tangential) / (1.0 + mu[i] ** 2)
                x = np.array([normal, *(mu[i] * normal / tangential * x[1:])])
            r[block] = x
    return r


# ------------------------------------------------------------------------------------------------ given files


@pytest.mark.parametrize("name", STORED)
def test_given_files_have_the_sizes_of_their_kind(shared_data: Path, name: str) -> None:
    full, n, s, _ = STORED[name]
    arrays = read_arrays(shared_data / "data" / "fc" / name)
    assert (arrays.reduced, arrays.count, arrays.block_size, arrays.dimension) == (not full, n, s, s)
    assert arrays.dilatancy is None
    for matrix in (arrays.W, arrays.M, arrays.H):
        assert matrix is None or (matrix.has_canonical_format and np.all(matrix.data != 0.0))


@pytest.mark.parametrize("name", STORED)
def test_delassus_operators_of_given_files_are_positive_semidefinite(shared_data: Path, name: str) -> None:
    """Blocks read row by row instead would give eigenvalues down to -0.08 to -0.5 of the largest."""
    W, _ = delassus(read_arrays(shared_data / "data" / "fc" / name))
    assert np.linalg.norm(W - W.T) <= STORED[name][3] * np.linalg.norm(W)
    eigenvalues = np.linalg.eigvalsh((W + W.T) / 2.0)
    assert eigenvalues[0] >= -1e-7 * eigenvalues[-1]


def test_the_stored_velocity_of_the_box_stacks_solves_the_problem_in_our_signs(shared_data: Path) -> None:
    """The file keeps u of its solution but neither r nor v; other signs or transposes do not give this u."""
    arrays = read_arrays(shared_data / "data" / "fc" / "Box_Stacks-i0122-82-5.hdf5")
    W, b = delassus(arrays)
    r = plain_gauss_seidel(W, b, arrays.mu, sweeps=200)
    assert np.linalg.norm(W @ r + b - arrays.solution.u) <= 1e-8 * np.linalg.norm(arrays.solution.u)
    assert not np.any(arrays.solution.r)
    assert not np.any(arrays.solution.v)
    assert len(arrays.guesses) == 1


@pytest.mark.parametrize("name", [name for name in STORED if not STORED[name][0]])
@pytest.mark.parametrize("written", ["again.hdf5", "again.dat"])
def test_given_reduced_files_survive_writing(
    shared_data: Path, tmp_path: Path, name: str, written: str
) -> None:
    arrays = replace(read_arrays(shared_data / "data" / "fc" / name), title="", description="", math_info="")
    write_arrays(tmp_path / written, arrays)
    assert_same(read_arrays(tmp_path / written), arrays)


def layout(path: Path) -> dict[str, tuple[str, int]]:
    """Every dataset of an HDF5 file with the type of its items and its number of axes."""
    found: dict[str, tuple[str, int]] = {}

    def note(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            kind = item.id.get_type()
            text = isinstance(kind, h5py.h5t.TypeStringID)
            found[name] = (f"string {kind.get_strpad()}" if text else str(item.dtype), len(item.shape))

    with h5py.File(path) as file:
        file.visititems(note)
    return found


@pytest.mark.parametrize("name", [name for name in STORED if name.endswith(".hdf5")])
def test_written_fclib_files_have_the_layout_of_given_ones(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    given, again = shared_data / "data" / "fc" / name, tmp_path / name
    arrays = read_arrays(given)
    write_arrays(again, arrays)
    assert layout(again) == layout(given)
    assert_same(read_arrays(again), arrays)
    with h5py.File(given) as old, h5py.File(again) as new:
        for matrix in ("fclib_local/W", "fclib_global/M", "fclib_global/H"):
            if matrix in old:
                assert all(new[f"{matrix}/{size}"][0] == old[f"{matrix}/{size}"][0] for size in "mn")
                assert (new[f"{matrix}/nz"][0] == -2) == (old[f"{matrix}/nz"][0] == -2)


# --------------------------------------------------------------------------------------------- made-up files


@pytest.mark.parametrize("s", [2, 3])
@pytest.mark.parametrize(("name", "storage"), [("p.dat", "blocks"), ("p.dat", "dense"), ("p.h5", "blocks")])
def test_reduced_problems_survive_bit_by_bit(tmp_path: Path, name: str, storage: str, s: int) -> None:
    arrays = made_up(s=s)
    write_arrays(tmp_path / name, arrays, storage)
    assert_same(read_arrays(tmp_path / name), arrays)


@pytest.mark.parametrize("name", ["none.dat", "none.hdf5"])
def test_no_contact_is_a_problem_too(tmp_path: Path, name: str) -> None:
    arrays = ProblemArrays(3, 3, np.zeros(0), W=sp.csr_array((0, 0)), b=np.zeros(0))
    write_arrays(tmp_path / name, arrays)
    assert_same(read_arrays(tmp_path / name), arrays)


@pytest.mark.parametrize("storage", ["blocks", "dense"])
def test_a_zero_delassus_operator_survives(tmp_path: Path, storage: str) -> None:
    arrays = replace(made_up(), W=sp.csr_array((12, 12)))
    write_arrays(tmp_path / "zero.dat", arrays, storage)
    assert_same(read_arrays(tmp_path / "zero.dat"), arrays)


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
    assert path.read_text().split()[-2:] == ["0.25", "0.75"]
    assert_same(read_arrays(path), arrays)
    write_arrays(path, replace(arrays, dilatancy=np.zeros(2)))
    assert read_arrays(path).dilatancy is None


# ------------------------------------------------------------------------------------------------- bad input


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


@pytest.mark.parametrize(
    "content", [b"", b"hello world", b"\x00\xff" * 40, b"\x89PNG\r\n\x1a\n 1 2", b"9" * 500]
)
def test_foreign_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "foreign.hdf5"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"foreign\.hdf5"):
        read_arrays(path)


@pytest.mark.parametrize("kept", range(0, 100, 9))
@pytest.mark.parametrize("name", ["p.dat", "p.hdf5"])
def test_truncated_files_are_refused(tmp_path: Path, name: str, kept: int) -> None:
    path = tmp_path / name
    write_arrays(path, made_up())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * kept // 100])
    with pytest.raises(InputError, match=name):
        read_arrays(path)


def test_damaged_bytes_never_raise_anything_but_the_error_for_input(tmp_path: Path) -> None:
    """Whatever the library below says of a broken structure, the caller sees one kind of error."""
    random = np.random.default_rng(7)
    path = tmp_path / "damaged.hdf5"
    write_arrays(path, made_up())
    whole = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    refused = 0
    for _ in range(300):
        broken = whole.copy()
        broken[random.integers(0, len(whole), 8)] = random.integers(0, 256, 8)
        path.write_bytes(broken.tobytes())
        try:
            read_arrays(path)
        except InputError as error:
            refused += "damaged.hdf5" in str(error)
    assert refused > 50


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.dat", tmp_path):
        with pytest.raises(InputError, match="no such file"):
            read_arrays(path)


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


def test_mixed_local_problems_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "mixed.hdf5"
    write_arrays(path, made_up())
    with h5py.File(path, "a") as file:
        file.create_group("fclib_local/V")
    with pytest.raises(InputError, match="mixed local problems"):
        read_arrays(path)


@pytest.mark.parametrize(
    ("name", "arrays", "says"),
    [
        ("p.txt", made_up(), r"\.hdf5, \.h5 or \.dat"),
        ("p", made_up(), "no suffix"),
        ("absent/p.dat", made_up(), "no such folder"),
        ("p.dat", made_up_full(), "reduced for .dat"),
        ("p.dat", replace(made_up(), solution=SolutionArrays(np.zeros(12), np.zeros(12))), "no place"),
        ("p.dat", replace(made_up(), b=np.zeros(5)), "shape of b"),
        ("p.dat", replace(made_up(), mu=np.array([0.1, -0.1, 0.1, 0.1])), "must be >= 0"),
        ("p.dat", replace(made_up(n=4, s=3), block_size=6, mu=np.ones(2)), "the dimension, for .dat"),
        ("p.hdf5", replace(made_up(n=4, s=3), block_size=6, mu=np.ones(2)), "for FCLIB"),
        ("p.hdf5", replace(made_up(), dilatancy=np.zeros(4)), "dilatancy"),
        ("p.hdf5", replace(made_up(), dilatancy=np.full(4, 9.0)), "between 0 and mu"),
        ("p.hdf5", replace(made_up_full(), C=None), "C and k together"),
        ("p.hdf5", replace(made_up_full(), H=None), "H = missing"),
        ("p.hdf5", replace(made_up(), W=None), "W or M"),
    ],
)
def test_what_a_format_has_no_place_for_is_refused(
    tmp_path: Path, name: str, arrays: ProblemArrays, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        write_arrays(tmp_path / name, arrays)
    assert list(tmp_path.iterdir()) == []


def test_unknown_storage_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'blocks' or 'dense'"):
        write_arrays(tmp_path / "p.dat", made_up(), "bricks")


@pytest.mark.parametrize("name", ["p.dat", "p.hdf5"])
def test_a_failed_write_leaves_the_old_file_and_no_litter(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    write_arrays(path, made_up())
    before = path.read_bytes()

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(InputError, match="No space left"):
        write_arrays(path, made_up(n=9))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "p.dat").mkdir()
    with pytest.raises(InputError, match="a folder"):
        write_arrays(tmp_path / "p.dat", made_up())
