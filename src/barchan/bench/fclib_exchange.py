"""FCLIB files answered by Siconos: read and written by FCLIB's own C library in the system's Python, judged by our certificate.

Siconos of Debian comes without its interface to FCLIB, so a child process calls `libfclib` itself and hands the matrices over.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import h5py

from barchan import friction
from barchan.bench.siconos import ISOLATED, SYSTEM_PYTHON, run_child
from barchan.errors import InputError
from barchan.friction.files import SolutionArrays, read_fclib
from barchan.friction.files.fclib import is_hdf5

CHILD = Path(__file__).with_name("_fclib_child.py")
PACKAGES = "python3-siconos libfclib-dev"
LARGEST = 6000  # rows of H or W: the child has them dense
_FOUND = "import sys, ctypes.util, siconos.numerics; sys.exit(0 if ctypes.util.find_library('fclib') else 1)"


@dataclass(frozen=True, eq=False)
class Answer:
    """What Siconos found. certificate : ours, of its forces (and velocities, where the problem has them).

    content : whether Siconos met its own tolerance.  iterations : of its Gauss-Seidel.  solution : as read from the file.
    """

    certificate: friction.Certificate
    content: bool
    iterations: int
    solution: SolutionArrays


def fclib_is_there() -> bool:
    """Whether the system's Python has Siconos, and FCLIB's library is installed."""
    if not SYSTEM_PYTHON.exists():
        return False
    return subprocess.run([*ISOLATED, _FOUND], capture_output=True).returncode == 0


def siconos_answer(
    path: str | PathLike[str], tolerance: float = 1e-8, iterations: int = 200_000, patience: float = 600.0
) -> Answer:
    """Let Siconos solve an FCLIB file by its Gauss-Seidel (NSGS) and certify what it finds; the file is left as it is.

    tolerance, iterations : of Siconos, in its own measure.  patience : seconds until it is given up.

    Raises
    ------
    InputError : Siconos or libfclib missing, a file that is not FCLIB's, bilateral rows, too many contacts, a solver that
        fails.
    """
    source = Path(path)
    problem = friction.read(source)
    form = _form(source)
    if not fclib_is_there():
        raise InputError("siconos", "not there", f"installed for {SYSTEM_PYTHON} (apt install {PACKAGES})")
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / "problem.hdf5"
        shutil.copyfile(source, copy)
        with h5py.File(copy, "a") as file:
            file.pop("solution", None)
        words = (copy, form, tolerance, iterations)
        command = [*ISOLATED, CHILD.read_text(encoding="utf-8"), *map(str, words)]
        said, wrong = run_child(command, patience)
        if wrong:
            raise InputError(str(source), f"Siconos {wrong}", "a problem that Siconos solves")
        told = json.loads(said.strip().splitlines()[-1])
        solution = read_fclib(copy).solution
    assert solution is not None
    certificate = friction.certify(problem, solution.r, None if problem.is_reduced else solution.v)
    return Answer(certificate, told["ended"] == 0, told["iterations"], solution)


def _form(source: Path) -> str:
    """ "local" or "global", of a file that the child can take."""
    arrays = read_fclib(source) if is_hdf5(source) else None
    if arrays is None:
        raise InputError(str(source), "not HDF5", "an FCLIB file")
    if arrays.k is not None or arrays.c is not None:
        raise InputError(str(source), "bilateral rows", "contacts alone")
    rows = len(arrays.mu) * arrays.dimension
    if rows > LARGEST:
        raise InputError(str(source), f"{rows} rows", f"at most {LARGEST}")
    return "local" if arrays.reduced else "global"
