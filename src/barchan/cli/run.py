"""`barchan run` and `barchan scenes`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from barchan import scenes
from barchan.cli import INTERRUPTED, NOT_CONVERGED
from barchan.errors import InputError
from barchan.scenes.kinds import find_kind
from barchan.scenes.loading import parse_setting

RUNS_FOLDER = Path("runs")


def run_command(scene_name: str, out: Path | None, settings: list[str], resume: bool, quiet: bool) -> int:
    """Run a scene; the exit code. Raises InputError for bad input."""
    scene = scenes.load(scene_name, **dict(parse_setting(text) for text in settings))
    if out is None:
        if resume:
            raise InputError("--out", "missing", f"given with --resume{_latest(scene.name)}")
        out = _new_folder(scene.name)
    try:
        finished = scene.run(out=out, resume=resume, progress=not quiet)
    except KeyboardInterrupt:
        again = shlex.join(["barchan", "run", str(out / "scene.toml"), "--out", str(out), "--resume"])
        sys.stderr.write(f"barchan: interrupted; continue with: {again}\n")
        return INTERRUPTED
    if not quiet:
        _show_summary(finished)
    return _judge(finished.summary)


def list_scenes() -> None:
    """A table of the presets on standard output."""
    table = Table(title="scenes", title_justify="left")
    for heading in ("name", "kind", "size", "description"):
        table.add_column(heading, no_wrap=heading in ("name", "kind"))
    for name in scenes.preset_names():
        parameters = scenes.load(name).parameters
        size = f"{parameters.dimension}D, {parameters.size}"
        table.add_row(name, parameters.scene.kind, size, parameters.scene.description)
    Console().print(table)


def _show_summary(finished: scenes.Run) -> None:
    """The figures a person asks for first."""
    console = Console()
    if finished.already_finished:
        console.print(f"{finished.folder} holds this run, already finished:", highlight=False, soft_wrap=True)
    table = Table(show_header=False, box=None)
    for name, value in _figures(finished):
        table.add_row(name, value)
    console.print(table)
    console.print(f"results, summary and pictures: {finished.folder}", highlight=False, soft_wrap=True)


def _figures(finished: scenes.Run) -> list[tuple[str, str]]:
    summary = finished.summary
    kind = finished.results.scene["scene"]["kind"]
    return [
        *find_kind(kind).figures(summary),
        ("worst certificate", f"{summary['worst_certificate']:.1e}, tolerance {summary['tolerance']:.0e}"),
        ("steps, sweeps", f"{summary['steps']}, {summary['sweeps']}"),
        ("time", f"{summary['seconds_total']:.1f} s on {summary['threads']} threads"),
    ]


def _judge(summary: dict[str, Any]) -> int:
    """Exit code of a run: 3, with a line on standard error, when steps missed the tolerance."""
    if summary["converged"]:
        return 0
    sys.stderr.write(
        f"barchan: not converged: {summary['unconverged_steps']} of {summary['steps']} steps missed "
        f"the tolerance {summary['tolerance']:g} (worst certificate {summary['worst_certificate']:.1e})\n"
    )
    return NOT_CONVERGED


def _new_folder(name: str) -> Path:
    """The first runs/<name>-<n> that does not exist."""
    number = 1
    while (RUNS_FOLDER / f"{name}-{number}").exists():
        number += 1
    return RUNS_FOLDER / f"{name}-{number}"


def _latest(name: str) -> str:
    """', for example runs/<name>-<n>' for the newest run of the scene, if there is one."""
    number = int(_new_folder(name).name.rpartition("-")[2]) - 1
    return f", for example --out {RUNS_FOLDER / f'{name}-{number}'}" if number else ""
