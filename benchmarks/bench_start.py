"""Seconds from `barchan run` to the end of the first time step, with a cold and a warm cache of compiled kernels.

The command runs in a child process with a NUMBA_CACHE_DIR of its own and is ended as soon as the first step is on the disk.
Peers of the same run: importing the libraries alone, and `barchan --help`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, sleep

from _table import environment, print_table

POLL = 0.002
LONGEST = 600.0


def seconds_of(arguments: list[str], cache: Path) -> float:
    """Seconds a command takes to its end."""
    began = perf_counter()
    subprocess.run(arguments, env=environment(NUMBA_CACHE_DIR=str(cache)), check=True, capture_output=True)
    return perf_counter() - began


def seconds_to_first_step(scene: str, cache: Path, folder: Path) -> float:
    """Seconds until the first frame after the initial one is in the run folder; a frame is one step long here."""
    command = [sys.executable, "-m", "barchan.cli", "run", scene, "--quiet", "--out", str(folder)]
    command += [
        "--set",
        "time.frame_rate=480",
        "--set",
        "time.step=0.0020833333333333333",
        "--set",
        "time.end=1.0",
    ]
    began = perf_counter()
    process = subprocess.Popen(command, env=environment(NUMBA_CACHE_DIR=str(cache)))
    try:
        while not (folder / "frames" / "frame_00001.h5").exists():
            if process.poll() is not None:
                raise SystemExit(
                    f"barchan run {scene} ended with exit code {process.returncode} before its first step"
                )
            if perf_counter() - began > LONGEST:
                raise SystemExit(f"barchan run {scene} made no step in {LONGEST:g} s")
            sleep(POLL)
        return perf_counter() - began
    finally:
        process.kill()
        process.wait()


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["collapse", "collapse_3d"])
    parser.add_argument("--repeats", type=int, default=3, help="warm starts, of which the shortest counts")
    choice = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as place:
        base = Path(place)
        libraries = "import numpy, scipy.sparse.linalg, numba, h5py, pydantic, typer, rich"
        rows.append(
            ("import of the libraries alone", None, seconds_of([sys.executable, "-c", libraries], base))
        )
        rows.append(
            ("barchan --help", None, seconds_of([sys.executable, "-m", "barchan.cli", "--help"], base))
        )
        for scene in choice.scenes:
            cache = base / f"cache-{scene}"
            cold = seconds_to_first_step(scene, cache, base / f"{scene}-cold")
            warm = min(
                seconds_to_first_step(scene, cache, base / f"{scene}-warm-{turn}")
                for turn in range(choice.repeats)
            )
            rows.append((f"barchan run {scene}, to the first step", cold, warm))
    print_table("Starting", ("what", "cold cache, s", "warm cache, s"), rows)


if __name__ == "__main__":
    main()
