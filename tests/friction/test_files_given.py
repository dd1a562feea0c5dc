"""Problems saved by other people's simulations read as what they are and survive writing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from stored_problems import STORED, assert_same, delassus

from barchan.errors import InputError
from barchan.friction import read, write
from barchan.friction.files import read_arrays, write_arrays


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


@pytest.mark.parametrize("name", STORED)
@pytest.mark.parametrize("written", ["again.hdf5", "again.dat"])
def test_given_files_survive_writing_in_either_format(
    shared_data: Path, tmp_path: Path, name: str, written: str
) -> None:
    given = read_arrays(shared_data / "data" / "fc" / name)
    arrays = replace(given, solution=None, guesses=(), title="", description="", math_info="")
    write_arrays(tmp_path / written, arrays)
    assert_same(read_arrays(tmp_path / written), arrays)


@pytest.mark.parametrize("name", STORED)
def test_problems_of_given_files_survive_writing(shared_data: Path, tmp_path: Path, name: str) -> None:
    """As `Problem`, through the room's entrance: same operator, free velocity and law."""
    problem = read(shared_data / "data" / "fc" / name)
    write(tmp_path / "again.hdf5", problem)
    again = read(tmp_path / "again.hdf5")
    np.testing.assert_array_equal(again.parameters, problem.parameters)
    for field in ("W", "b") if problem.is_reduced else ("M", "f", "H", "w"):
        old, new = getattr(problem, field), getattr(again, field)
        np.testing.assert_array_equal(
            new.toarray() if sp.issparse(new) else new, old.toarray() if sp.issparse(old) else old
        )


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


@pytest.mark.parametrize("name", STORED)
def test_given_files_cut_anywhere_are_refused(shared_data: Path, tmp_path: Path, name: str) -> None:
    """Also inside the last number, which would read as another one; a lost flag or line break is no loss."""
    whole = (shared_data / "data" / "fc" / name).read_bytes()
    text = whole.rstrip()
    end = len(text[:-1].rstrip()) if text[-2:-1].isspace() else len(text)
    cuts = [0, 1, 7, *(len(whole) * part // 16 for part in range(1, 16))]
    cuts += [end - lost for lost in (1, 2, 3, 4, 9)] if name.endswith(".dat") else [len(whole) - 1]
    path = tmp_path / name
    for cut in cuts:
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=name) as caught:
            read_arrays(path)
        assert "\n" not in str(caught.value)
