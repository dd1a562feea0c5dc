"""The peers: solvers of Siconos in processes of the system's Python, judged by our certificate and timed on the same problem.

Their own tolerance is lowered by tens until our certificate is met; that solve alone is then timed. A crash, a refusal or a
hang of a peer is a note in the table: every peer and problem has a process of its own, killed when it takes too long.
"""

from __future__ import annotations

import math
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from barchan import friction
from barchan.bench.measurement import LATE, LONG, Measurement, Solver
from barchan.errors import InputError
from barchan.friction.operators import StoredDelassus, build_operator

SYSTEM_PYTHON = Path("/usr/bin/python3")
ISOLATED = (
    str(SYSTEM_PYTHON),
    "-I",
    "-c",
)  # so that nothing of this folder or of PYTHONPATH comes in its way
CHILD = Path(__file__).with_name("_siconos_child.py")
FIRST_POWER, MORE_POWERS = 2, 5
START_SECONDS, SLACK = 20.0, 4.0
SPATIAL = {
    "Siconos NSGS": ("SICONOS_FRICTION_3D_NSGS", 20_000),
    "Siconos ADMM": ("SICONOS_FRICTION_3D_ADMM", 20_000),
    "Siconos Newton": ("SICONOS_FRICTION_3D_NSN_AC", 2_000),
}
PLANE = {
    "Siconos NSGS": ("SICONOS_FRICTION_2D_NSGS", 20_000),
    "Siconos Lemke": ("SICONOS_FRICTION_2D_LEMKE", 20_000),
    "Siconos CPG": ("SICONOS_FRICTION_2D_CPG", 20_000),
}
PEERS = tuple(dict.fromkeys((*SPATIAL, *PLANE)))


def siconos_is_there() -> bool:
    """Whether the system's Python has Siconos."""
    if not SYSTEM_PYTHON.exists():
        return False
    return subprocess.run([*ISOLATED, "import siconos.numerics"], capture_output=True).returncode == 0


def peer(solver: str) -> Solver:
    """One of PEERS, to be measured like a method of barchan."""

    def measured(
        name: str, problem: friction.Problem, tolerance: float, time_limit: float, repeats: int
    ) -> Measurement:
        known = PLANE if problem.s == 2 else SPATIAL
        if solver not in known:
            return Measurement(name, solver, note=f"not for block size {problem.s}")
        small = reduced(problem)
        with tempfile.TemporaryDirectory() as place:
            source = Path(place) / "problem.dat"
            try:
                friction.write(source, small)
            except InputError as error:
                return Measurement(
                    name, solver, note=f"not for this problem: {error.field} must be {error.allowed}"
                )
            return _solve(name, solver, small, source, known[solver], (tolerance, time_limit, repeats))

    return measured


def reduced(problem: friction.Problem) -> friction.Problem:
    """The reduced form of a problem, with W stored."""
    if problem.is_reduced:
        return problem
    operator = build_operator(problem, "explicit")
    assert isinstance(operator, StoredDelassus)
    W = sp.csr_array(operator.rows.matrix())
    return friction.Problem.reduced(
        W=W, b=operator.b.reshape(-1), law=problem.law, block_size=problem.s,
        reference_force=problem.reference_force,
    )  # fmt: skip


def _solve(
    name: str,
    solver: str,
    problem: friction.Problem,
    source: Path,
    driver: tuple[str, int],
    request: tuple[float, float, int],
) -> Measurement:
    tolerance, time_limit, repeats = request
    target = source.with_name("answer.npz")

    def ask(powers: tuple[int, ...], times: int) -> str:
        words = (source, target, *driver, time_limit, times, *powers)
        command = [*ISOLATED, CHILD.read_text(encoding="utf-8"), *map(str, words)]
        return run_child(command, START_SECONDS + SLACK * time_limit * times)[1]

    last = math.ceil(-math.log10(tolerance)) + MORE_POWERS
    note = ask(tuple(range(FIRST_POWER, max(last, FIRST_POWER) + 1)), 1)
    history = _answers(problem, target)
    if not history:
        return Measurement(name, solver, note=note or "no answer")
    good = [answer for answer in history if answer[1] <= tolerance]
    chosen = good[0] if good else min(history, key=lambda answer: answer[1])
    curve = [(seconds, certificate) for _, certificate, seconds, _ in history]
    if good and repeats > 1 and chosen[2] < LONG:
        target.unlink()
        ask((chosen[0],), repeats)
        again = _answers(problem, target)
        chosen = again[0] if again and again[0][1] <= tolerance else chosen
    _, certificate, seconds, iterations = chosen
    note = "" if good else note or "tolerance not reached"
    if good and seconds > time_limit:
        return Measurement(name, solver, certificate, iterations, seconds, False, curve, LATE)
    return Measurement(name, solver, certificate, iterations, seconds, bool(good), curve, note)


def run_child(command: list[str], timeout: float) -> tuple[str, str]:
    """Run a process of the system's Python; what it printed, and what went wrong, or nothing."""
    try:
        ended = subprocess.run(command, capture_output=True, timeout=timeout, text=True, errors="replace")
    except subprocess.TimeoutExpired:
        return "", f"killed after {timeout:.3g} s"
    if ended.returncode < 0:
        return ended.stdout, f"crashed ({signal.Signals(-ended.returncode).name})"
    reason = " ".join(ended.stderr.strip().splitlines()[-1:])
    wrong = f"failed with exit code {ended.returncode}: {reason}" if ended.returncode else ""
    return ended.stdout, wrong


def _answers(problem: friction.Problem, target: Path) -> list[tuple[int, float, float, int]]:
    """(power of its tolerance, our certificate, seconds, iterations) of every answer a child left."""
    if not target.exists():
        return []
    with np.load(target) as file:
        kept = {key: file[key] for key in ("powers", "forces", "seconds", "iterations")}
    certificates = [_certificate(problem, r) for r in kept["forces"]]
    return [
        (int(power), certificate, float(seconds), int(count))
        for power, certificate, seconds, count in zip(
            kept["powers"], certificates, kept["seconds"], kept["iterations"], strict=True
        )
    ]


def _certificate(problem: friction.Problem, r: np.ndarray) -> float:
    return friction.certify(problem, r).residual if np.isfinite(r).all() else float("inf")
