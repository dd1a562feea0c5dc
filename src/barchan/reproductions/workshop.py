"""Where a reproduction runs its scenes, keeps finished ones, and puts its tables and pictures."""

from __future__ import annotations

import csv
import hashlib
import io
import multiprocessing
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from barchan import scenes
from barchan.errors import InputError
from barchan.results import Results
from barchan.results import open as open_results
from barchan.scenes.scene import observables_of
from barchan.storage import unwritable, write_text

RUNS_FOLDER = "runs"


@dataclass(frozen=True)
class Table:
    """A table of texts: published figures beside ours."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Report:
    """What a reproduction has found. notes : sentences.  converged : whether every run met its tolerance."""

    tables: list[Table]
    notes: list[str] = field(default_factory=list)
    converged: bool = True


@dataclass(frozen=True)
class Job:
    """A run that is wanted: a name for its folder, a scene and its overrides."""

    label: str
    scene: str
    overrides: Mapping[str, Any]


@dataclass(frozen=True)
class Finished:
    """A finished run: its summary, its observables (see `scenes.Run`) and its frames."""

    summary: dict[str, Any]
    observables: dict[str, np.ndarray]
    results: Results


class Workshop:
    """The folder of a reproduction.

    out : its folder; it may hold what an interrupted reproduction has left.  quick : fewer and coarser runs.
    processes : how many scenes run at a time, each on one thread when there are several.
    """

    def __init__(self, out: Path, quick: bool = False, processes: int = 1) -> None:
        if out.exists() and not out.is_dir():
            raise InputError(str(out), "a file", "a folder")
        try:
            (out / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(out, error) from error
        self.out, self.quick, self.processes = out, quick, processes

    def run(self, jobs: Sequence[Job]) -> list[Finished]:
        """Every job's finished run, in order; those already in the folder are not run again."""
        work = [(str(self._folder(job)), job.scene, dict(job.overrides)) for job in jobs]
        self.each(_run_scene, work, self.processes)
        return [_finished(Path(folder)) for folder, _, _ in work]

    def each(self, task: Callable[[Any], str], work: Sequence[Any], processes: int) -> None:
        """Do `task`, a function of a module, to every item, `processes` at a time; it returns a line that is told."""
        if processes == 1 or len(work) == 1:
            for number, item in enumerate(work, start=1):
                _tell(task(item), number, len(work))
        elif work:
            self._in_processes(task, work, processes)

    def _in_processes(self, task: Callable[[Any], str], work: Sequence[Any], processes: int) -> None:
        # Children start afresh, with one thread each: together they fill the machine, and their bytes do not depend on it.
        threads = {
            name: os.environ.get(name) for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
        }
        os.environ.update(dict.fromkeys(threads, "1"))
        try:
            context = multiprocessing.get_context("spawn")
            with ProcessPoolExecutor(min(processes, len(work)), mp_context=context) as pool:
                try:
                    for number, told in enumerate(pool.map(task, work), start=1):
                        _tell(told, number, len(work))
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
        finally:
            for name, value in threads.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value

    def _folder(self, job: Job) -> Path:
        """A folder that belongs to exactly this scene, so that another one never takes its place."""
        text = scenes.load(job.scene, **job.overrides).toml()
        return self.out / RUNS_FOLDER / f"{job.label}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"

    def write_csv(self, name: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        """A table of numbers, whole or not at all."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
        write_text(self.out / name, buffer.getvalue())

    def save(self, name: str, figure: Any) -> None:
        """A matplotlib figure as PNG, whole or not at all."""
        from barchan.results.figures import save_figure

        save_figure(figure, self.out / name)


def new_figure(width: float, height: float) -> Any:
    """`barchan.results.figures.new_figure`; matplotlib is loaded when the first picture is drawn."""
    from barchan.results.figures import new_figure as make

    return make(width, height)


def published(name: str) -> list[dict[str, str]]:
    """The rows of a published table that comes with the package, by column."""
    text = (resources.files("barchan.reproductions") / "published" / f"{name}.csv").read_text(
        encoding="utf-8"
    )
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def steady_value(run: Finished, span: float = 1.0) -> float:
    """Mean of what an inertial run watches over its last `span` of time: single values jump with the solver's tolerance."""
    steps = run.results.steps
    last = steps["time"] > steps["time"][-1] - span
    return float(steps["watched"][last].mean())


def all_converged(runs: Sequence[Finished]) -> bool:
    """Whether every run met its tolerance in every step."""
    return all(bool(run.summary["converged"]) for run in runs)


def _run_scene(item: tuple[str, str, dict[str, Any]]) -> str:
    """Run, resume or find a scene in its folder; a line about it."""
    folder, scene, overrides = item
    run = scenes.load(scene, **overrides).run(out=folder, resume=True, progress=False, pictures=False)
    name = Path(folder).name
    if run.already_finished:
        return f"{name}: finished before"
    summary = run.summary
    return f"{name}: {summary['seconds_total']:.0f} s, certificate {summary['worst_certificate']:.1e}"


def _finished(folder: Path) -> Finished:
    results = open_results(folder)
    return Finished(results.summary, observables_of(results), results)


def _tell(text: str, number: int, count: int) -> None:
    sys.stderr.write(f"{number}/{count} {text}\n")
