"""Problem files: frictional contact problems read from and written to disk as plain arrays.

FCLIB's HDF5 files and Siconos' token files `.dat`, reduced and global, become `ProblemArrays` in the signs of
DESIGN (seed B, 2.2-2.3): M v = f + H^T r + C^T l, C v = k, u = H v + w; reduced u = W r + b.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from barchan.errors import InputError
from barchan.friction.files.arrays import ProblemArrays, SolutionArrays
from barchan.friction.files.dat import read_dat, write_dat
from barchan.friction.files.fclib import is_hdf5, read_fclib, write_fclib

__all__ = [
    "ProblemArrays",
    "SolutionArrays",
    "read_arrays",
    "write_arrays",
    "read_dat",
    "write_dat",
    "read_fclib",
    "write_fclib",
]

_HDF5_SUFFIXES = (".hdf5", ".h5")


def read_arrays(path: str | PathLike[str]) -> ProblemArrays:
    """Read a problem file; what the file holds decides how, not its name.

    Parameters
    ----------
    path : FCLIB HDF5 file (local or global) or `.dat` token file (reduced or global).

    Raises
    ------
    InputError : the file is missing, truncated, foreign, inconsistent or holds numbers that are not finite;
        the error names the file and what is wrong.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(str(file), "no such file", "a problem file that exists")
    try:
        return read_fclib(file) if is_hdf5(file) else read_dat(file)
    except PermissionError as error:
        raise InputError(str(file), "not readable", "a file that may be read") from error


def write_arrays(path: str | PathLike[str], arrays: ProblemArrays, storage: str = "blocks") -> None:
    """Write a problem file; the suffix decides: `.hdf5` or `.h5` for FCLIB, `.dat` for tokens.

    The file appears whole or not at all: it is written beside its place and then moved there.

    Parameters
    ----------
    path : where to write; an existing file is replaced.
    arrays : the problem; `.dat` takes none with bilateral rows, stored solution or guesses, FCLIB none with dilatancy.
    storage : how `.dat` holds matrices: "blocks" (only blocks with a non-zero) or "dense".

    Raises
    ------
    InputError : unknown suffix, folder missing or not writable, arrays inconsistent, or a problem that the
        format has no place for.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix in _HDF5_SUFFIXES:
        write_fclib(file, arrays)
    elif suffix == ".dat":
        write_dat(file, arrays, storage)
    else:
        raise InputError(str(file), suffix or "no suffix", "a file name ending in .hdf5, .h5 or .dat")
