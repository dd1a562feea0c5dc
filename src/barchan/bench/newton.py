"""The peer of `barchan bench mpm`: NVIDIA Newton's implicit MPM in a process of an interpreter of its own (`_newton_child`).

Newton has other needs than barchan (`pip install newton` in a virtual environment); it computes on the processor here, in
single precision and on one thread.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

CHILD = Path(__file__).with_name("_newton_child.py")
VARIABLE = "BARCHAN_NEWTON"
USUAL_PLACE = Path.home() / ".cache" / "barchan-newton" / "env" / "bin" / "python"
PATIENCE = 900.0  # seconds for an answer; the first step compiles
ADVICE = (
    f"make a virtual environment, `pip install newton` in it, and name its Python by --newton or {VARIABLE}"
)


def find_newton(given: Path | None = None) -> Path | None:
    """An interpreter that has Newton: the one given, of the environment variable, of the usual place, or this one.

    Raises
    ------
    InputError : the one given, or that of the variable, has no Newton.
    """
    named = given or (Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None)
    if named is not None:
        if not _has_newton(named):
            raise InputError("newton", named, "a Python interpreter that can import newton")
        return named
    if USUAL_PLACE.exists() and _has_newton(USUAL_PLACE):
        return USUAL_PLACE
    return Path(sys.executable) if importlib.util.find_spec("newton") else None


def _has_newton(interpreter: Path) -> bool:
    question = "import importlib.util as u; raise SystemExit(u.find_spec('newton') is None)"
    try:
        return subprocess.run([str(interpreter), "-I", "-c", question], capture_output=True).returncode == 0
    except OSError:
        return False


@dataclass(frozen=True)
class PeerStep:
    """A step of Newton.

    seconds, processor : of the step, by the clock and of the processor.  solve : of its friction problem.
    looks : how often it looked at its residuals.
    residuals : its own (root mean square, largest) change of strain in the last sweep.
    kept : arrays of the friction problem and its answer; empty where Newton does not show them.
    """

    seconds: float
    processor: float
    solve: float | None
    looks: int
    residuals: tuple[float, float] | None
    kept: dict[str, NDArray[np.generic]]


class NewtonFailure(Exception):
    """Newton crashed, hung or refused; the message says what is known."""


class Newton:
    """A running simulation of Newton; a context.

    column : arrays and numbers that `_newton_child` reads, by name.

    Raises NewtonFailure where the process does not start; so does `advance`.
    """

    def __init__(self, interpreter: Path, column: dict[str, Any]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="barchan-newton-")
        place = Path(self._folder.name)
        np.savez(place / "column.npz", **column)
        self._log = (place / "log").open("w+", encoding="utf-8", errors="replace")
        self._process = subprocess.Popen(
            [str(interpreter), "-I", str(CHILD), str(place / "column.npz")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
        )  # fmt: skip
        try:
            self.versions: dict[str, str] = self._answer()
        except NewtonFailure:
            self.close()
            raise

    def __enter__(self) -> Newton:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def advance(self, steps: int, keep: bool) -> tuple[list[PeerStep], NDArray[np.float64] | None]:
        """Make steps; with `keep` also their friction problems, and the positions (P, 3) [m] after the last."""
        with tempfile.TemporaryDirectory(dir=self._folder.name) as folder:
            answer = self._ask({"steps": steps, "keep": folder if keep else None})
            made = [
                PeerStep(
                    step["seconds"],
                    step["processor"],
                    step["solve"],
                    step["checks"],
                    tuple(step["residuals"]) if step["residuals"] else None,
                    _read(Path(folder) / f"{number}.npz"),
                )
                for number, step in enumerate(answer["steps"])
            ]
            path = Path(folder) / "positions.npy"
            return made, np.load(path).astype(float) if path.exists() else None

    def close(self) -> None:
        """End the process and forget its files."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # where it has gone before
                    pipe.close()
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        self._folder.cleanup()

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            raise NewtonFailure(self._reason()) from None
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        late = threading.Timer(PATIENCE, self._process.kill)
        late.start()
        try:
            line = self._process.stdout.readline()
        finally:
            late.cancel()
        if not line:
            raise NewtonFailure(self._reason())
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _reason(self) -> str:
        code = self._process.wait()
        self._log.seek(0)
        last = [line for line in self._log.read().splitlines() if line.strip()][-1:]
        return f"Newton ended with code {code}: {' '.join(last)}"


def _read(path: Path) -> dict[str, NDArray[np.generic]]:
    if not path.exists():
        return {}
    with np.load(path) as file:
        return {name: file[name] for name in file.files}
