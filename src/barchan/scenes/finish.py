"""The end of a run: results.h5, XDMF, pictures, summary; then the work files go. Repeating any part of it is harmless.

summary.json is written last, so a folder that has it is finished; everything before can be redone from the
frames.
"""

from __future__ import annotations

import json
import math
import platform
from pathlib import Path
from typing import Any

from barchan.results import FolderStore, Results, assemble, write_xdmf
from barchan.results import open as open_results
from barchan.results.store import PICTURES_FOLDER, SUMMARY_FILE, XDMF_FILE, make_folder
from barchan.scenes.observables import summarise, surface_of
from barchan.scenes.parameters import SceneParameters
from barchan.scenes.progress import Progress
from barchan.scenes.runner import Clock
from barchan.storage import write_text


def is_finished(store: FolderStore) -> bool:
    """Whether the run in the folder has been brought to its end."""
    return store.results_path.exists() and store.path(SUMMARY_FILE).exists()


def finish_folder(
    parameters: SceneParameters, scene_toml: str, store: FolderStore, clock: Clock, progress: Progress
) -> Results:
    """Turn the frames of a completed run into its final files. Raises InputError for a damaged frame or a full disk."""
    if not store.results_path.exists():
        progress.note("writing results.h5")
        assemble(store, parameters.frame_count + 1, scene_toml, store.results_path)
    write_xdmf(store.results_path, store.path(XDMF_FILE))
    results = open_results(store.folder)
    summary = full_summary(parameters, results, clock)
    progress.note("drawing pictures")
    draw_pictures(parameters, results, summary, store.path(PICTURES_FOLDER))
    write_text(store.path(SUMMARY_FILE), json.dumps(_json_ready(summary), indent=2) + "\n")
    store.discard_work_files()
    return results


def full_summary(parameters: SceneParameters, results: Results, clock: Clock) -> dict[str, Any]:
    """Figures of the run, with times, threads and versions."""
    return {
        **summarise(parameters, results.steps, results.observables),
        "particles": len(results.particles(0)["volumes"]),
        "seconds_total": clock.seconds,
        "seconds_per_step": clock.seconds_per_step,
        "threads": _threads(),
        "versions": _versions(),
    }


def draw_pictures(
    parameters: SceneParameters, results: Results, summary: dict[str, Any], folder: Path
) -> None:
    """strip.png, profile.png, observables.png and collapse.gif in `folder`."""
    from barchan.results.animation import draw_animation
    from barchan.results.pictures import draw_observables, draw_profile, draw_strip

    make_folder(folder)
    title = parameters.scene.description or parameters.scene.name
    until = _end_of_motion(results)
    draw_strip(folder / "strip.png", results, until, title)
    initial, final = (
        surface_of(parameters, results.particles(frame)["positions"], results.particles(frame)["volumes"])
        for frame in (0, -1)
    )
    verdict = (
        f"{title}\nrun-out (L - L0)/L0 = {summary['run_out']:.2f}, "
        f"height H/H0 = {summary['height_ratio']:.2f}, steepest slope {summary['slope_steepest']:.0f}°"
    )
    box = (parameters.box.size[0], parameters.box.size[-1])
    draw_profile(folder / "profile.png", initial.x, initial.height, final.height, box, verdict)
    draw_observables(
        folder / "observables.png", results.steps, results.observables, parameters.dimension, title
    )
    draw_animation(folder / "collapse.gif", results, until, title)


def _end_of_motion(results: Results) -> float:
    """Time (s) after which the bulk of the front moves by less than 1 % of its whole way, at least a tenth of the run."""
    front, times = results.observables["front_bulk"], results.times
    far = abs(front - front[-1]) > 0.01 * max(abs(front[-1] - front[0]), 1e-12)
    last = int(far.nonzero()[0][-1]) + 1 if far.any() else 0
    return float(max(times[min(last, len(times) - 1)], 0.1 * times[-1]))


def _threads() -> int:
    import numba

    return int(numba.get_num_threads())


def _versions() -> dict[str, str]:
    import h5py
    import numba
    import numpy
    import scipy

    from barchan import __version__

    modules = {"numpy": numpy, "scipy": scipy, "numba": numba, "h5py": h5py}
    return {
        "barchan": __version__,
        "python": platform.python_version(),
        **{name: str(module.__version__) for name, module in modules.items()},
    }


def _json_ready(value: Any) -> Any:
    """Numbers that JSON cannot hold (NaN, infinity) become null."""
    if isinstance(value, dict):
        return {key: _json_ready(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
