"""Stored contact problems: which method reaches the certificate, in how many iterations and milliseconds; as Markdown.

Each solve starts from zero on a problem built anew, after one that compiles; the shortest of the repeats counts. The peer is
the nonsmooth Gauss-Seidel method of Siconos, in a process of the system's Python where that has it, on the same operators and
judged by the same certificate: its own tolerance is lowered by tens until the certificate is met, and that solve is timed.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from _table import print_table
from barchan import friction
from barchan.errors import InputError
from barchan.friction.operators import StoredDelassus, build_operator

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "fc"
SYSTEM_PYTHON = "/usr/bin/python3"
SICONOS = "Siconos NSGS"
PEER = """
import sys, time
import numpy as np
import siconos.numerics as sn
source, target, sweeps, repeats = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
problem = sn.frictionContactProblemFromFile(source)
size = problem.numberOfContacts * problem.dimension
plane = problem.dimension == 2
options = sn.SolverOptions(sn.SICONOS_FRICTION_2D_NSGS if plane else sn.SICONOS_FRICTION_3D_NSGS)
options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = sweeps
driver = sn.fc2d_driver if plane else sn.fc3d_driver
forces, seconds, iterations = [], [], []
for power in range(2, 13):
    options.dparam[sn.SICONOS_DPARAM_TOL] = 10.0 ** -power
    times = []
    for _ in range(repeats):
        r, u = np.zeros(size), np.zeros(size)
        began = time.perf_counter()
        driver(problem, r, u, options)
        times.append(time.perf_counter() - began)
    forces.append(r), seconds.append(min(times)), iterations.append(options.iparam[sn.SICONOS_IPARAM_ITER_DONE])
    if iterations[-1] >= sweeps:
        break
np.savez(target, forces=forces, seconds=seconds, iterations=iterations)
"""


def cell(certificate: float, iterations: int, seconds: float, tolerance: float) -> str:
    """Milliseconds and iterations, or the certificate that was not good enough."""
    if certificate <= tolerance:
        return f"{1e3 * seconds:.3g} ms, {iterations}"
    return f"no: {certificate:.1e} in {1e3 * seconds:.3g} ms, {iterations}"


def solved(path: Path, method: str, tolerance: float, iterations: int, repeats: int) -> str:
    """The cell of one of our methods."""
    best = None
    for turn in range(repeats + 1):
        problem = friction.read(path)
        solution = friction.solve(problem, method, tol=tolerance, max_iterations=iterations)
        if turn > 0 and (best is None or solution.elapsed < best.elapsed):
            best = solution
    assert best is not None
    return cell(best.certificate.residual, best.iterations, best.elapsed, tolerance)


def solved_by_siconos(path: Path, tolerance: float, sweeps: int, repeats: int, patience: float) -> str:
    """The cell of the peer; the problem goes to it as a sparse-block `.dat` file."""
    problem = reduced(friction.read(path))
    with tempfile.TemporaryDirectory() as place:
        source, target = Path(place) / "problem.dat", Path(place) / "answer.npz"
        try:
            friction.write(source, problem)
        except InputError as error:
            return f"not asked: {error.allowed}"
        command = [SYSTEM_PYTHON, "-c", PEER, str(source), str(target), str(sweeps), str(repeats)]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=patience)
        except subprocess.TimeoutExpired:
            return f"stopped after {patience:g} s"
        except subprocess.CalledProcessError as error:
            return f"failed with exit code {error.returncode}"
        answer = np.load(target)
        certificates = [friction.certify(problem, r).residual for r in answer["forces"]]
        good = [k for k, value in enumerate(certificates) if value <= tolerance]
        best = good[0] if good else int(np.argmin(certificates))
        return cell(
            certificates[best], int(answer["iterations"][best]), float(answer["seconds"][best]), tolerance
        )


def reduced(problem: friction.Problem) -> friction.Problem:
    """The reduced form of a problem."""
    if problem.is_reduced:
        return problem
    operator = build_operator(problem, "explicit")
    assert isinstance(operator, StoredDelassus)
    W = sp.csr_array(operator.rows.matrix())
    return friction.Problem.reduced(W=W, b=operator.b.reshape(-1), law=problem.law, block_size=problem.s)


def siconos_is_there() -> bool:
    """Whether the system's Python has Siconos."""
    if not Path(SYSTEM_PYTHON).exists():
        return False
    return (
        subprocess.run([SYSTEM_PYTHON, "-c", "import siconos.numerics"], capture_output=True).returncode == 0
    )


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help=f"problem files; default: all of {DATA}")
    parser.add_argument("--methods", nargs="+", default=list(friction.methods()))
    parser.add_argument("--tol", type=float, default=1e-4)
    parser.add_argument("--max-iterations", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--patience", type=float, default=300.0, help="seconds the peer may take for one problem"
    )
    parser.add_argument("--no-peer", action="store_true")
    choice = parser.parse_args()
    files = choice.files or sorted(path for path in DATA.glob("*") if path.suffix in (".dat", ".hdf5"))
    if not files:
        raise SystemExit(
            f"no problem files: {DATA} is kept beside the repository, not in it; name some files"
        )
    peer = not choice.no_peer and siconos_is_there()
    rows = []
    for path in files:
        problem = friction.read(path)
        form = "reduced" if problem.is_reduced else "full"
        cells = [
            solved(path, name, choice.tol, choice.max_iterations, choice.repeats) for name in choice.methods
        ]
        if peer:
            cells.append(
                solved_by_siconos(path, choice.tol, choice.max_iterations, choice.repeats, choice.patience)
            )
        rows.append((path.name, form, problem.n, problem.s, *cells))
    heads = ("problem", "form", "n", "s", *choice.methods, *([SICONOS] if peer else []))
    print_table(f"Time and iterations to a certificate of {choice.tol:g}", heads, rows)
    if not peer and not choice.no_peer:
        print(f"\n{SICONOS} is left out: {SYSTEM_PYTHON} does not have the package siconos.")


if __name__ == "__main__":
    main()
