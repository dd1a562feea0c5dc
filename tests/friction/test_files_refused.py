"""Foreign, truncated and damaged files, and problems a format has no place for, are one clear error; nothing is lost."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from stored_problems import made_up, made_up_full

from barchan.errors import InputError
from barchan.friction.files import ProblemArrays, SolutionArrays, read_arrays, write_arrays


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


@pytest.mark.parametrize(
    ("name", "arrays", "says"),
    [
        ("p.txt", made_up(), r"\.hdf5, \.h5 or \.dat"),
        ("p", made_up(), "no suffix"),
        ("absent/p.dat", made_up(), "no such folder"),
        ("p.dat", made_up_full(), "bilateral rows"),
        (
            "p.dat",
            replace(made_up_full(), C=None, k=None, solution=None, guesses=(), dilatancy=np.zeros(3)),
            "in reduced problems only",
        ),
        ("p.dat", replace(made_up(), P=sp.csr_array((1, 1))), "all of B, P and c"),
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
