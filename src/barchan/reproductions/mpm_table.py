"""Sizes and seconds per frame of the material point scenes (seed B, Table 7.1)."""

from __future__ import annotations

from typing import Any

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, published

TITLE = "Sizes and times of the material point scenes (seed B, Table 7.1)"

FRAMES = 24
QUICK_FRAMES = 2
SCENES: dict[
    str, tuple[str, dict[str, Any]]
] = {  # row of the table -> scene and what gives it the grid of the seed
    "collapse": ("collapse_3d", {}),
    "zb05": ("zb05", {"box.cells": [100, 100, 50]}),
    "wheel": ("wheel", {"box.cells": [42, 28, 14]}),
    "silo": ("silo_3d", {"box.cells": [36, 36, 72]}),
    "writing": ("writing", {"box.cells": [96, 48, 24]}),
    "cohesion": ("tower", {"box.cells": [80, 80, 40]}),
    "digging": ("digging", {"box.cells": [64, 64, 32]}),
    "crater": ("crater", {"box.cells": [75, 75, 50], "per_cell": 2}),
    "treasure": ("treasure", {"box.cells": [70, 70, 50]}),
}
COARSE: dict[str, dict[str, Any]] = {
    "collapse": {"box.cells": [20, 5, 10], "per_cell": 2},
    "zb05": {"box.cells": [25, 25, 12], "per_cell": 2},
    "wheel": {"box.cells": [20, 10, 6]},
    "silo": {"box.cells": [12, 12, 24], "per_cell": 2},
    "writing": {"box.cells": [28, 14, 7]},
    "cohesion": {"box.cells": [20, 20, 10], "per_cell": 2},
    "digging": {"box.cells": [24, 24, 12], "per_cell": 2},
    "crater": {"box.cells": [15, 15, 10], "per_cell": 2},
    "treasure": {"box.cells": [18, 18, 12], "per_cell": 2},
}


def reproduce(workshop: Workshop) -> Report:
    """The first 24 frames of every scene on the seed's grid, one scene at a time; quickly two frames on coarse grids."""
    theirs = {row["scene"]: row for row in published("mpm_scenes")}
    frames = QUICK_FRAMES if workshop.quick else FRAMES
    alone = Workshop(workshop.out, workshop.quick, processes=1)  # each has the whole machine
    runs = alone.run([_job(name, float(theirs[name]["fps"]), frames, workshop.quick) for name in SCENES])
    rows = [_row(theirs[name], run, frames) for name, run in zip(SCENES, runs, strict=True)]
    columns = (
        "scene", "grid, seed B", "ours", "particles, seed B", "ours", "nodes, seed B", "ours", "s/frame, seed B", "ours",
    )  # fmt: skip
    workshop.write_csv("table.csv", columns, rows)
    notes = [
        f"Ours: mean of the first {frames} frames at the seed's frames per second, compiled, on this machine's "
        "threads; the seed's: mean of the whole run on a quad-core Xeon. Sizes are maxima, so far.",
        "Pieces of matter and bodies of which the seed gives no sizes are ours (see the scenes' files).",
    ]
    return Report([Table("Table 7.1 beside ours", columns, rows)], notes, all_converged(runs))


def _job(name: str, rate: float, frames: int, quick: bool) -> Job:
    scene, full = SCENES[name]
    size = COARSE[name] if quick else full
    overrides: dict[str, Any] = {**size, "time.end": frames / rate, "time.frame_rate": rate}
    return Job(f"table-{name}", scene, overrides)


def _row(theirs: dict[str, str], run: Finished, frames: int) -> tuple[str, ...]:
    summary, steps = run.summary, run.results.steps
    seconds = summary["seconds_per_step"]
    ours = "" if seconds is None else f"{seconds * summary['steps'] / frames:.2f}"
    grid = "x".join(str(count) for count in run.results.scene["box"]["cells"])
    return (
        theirs["scene"], theirs["grid"], grid, theirs["particles"], f"{int(steps['particles'].max()):.2e}",
        theirs["nodes"], f"{int(steps['active_nodes'].max())}", theirs["s_per_frame"], ours,
    )  # fmt: skip
