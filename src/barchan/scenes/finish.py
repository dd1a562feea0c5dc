"""The end of a run: results.h5, XDMF, VTU, pictures, summary; then the work files go. Repeating any part of it is harmless.

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
from barchan.results.frames import MESH
from barchan.results.store import FIELDS_FILE, PICTURES_FOLDER, SUMMARY_FILE, XDMF_FILE, make_folder
from barchan.scenes.kinds import find_kind
from barchan.scenes.parameters import SceneParameters
from barchan.scenes.progress import Progress
from barchan.scenes.runner import Clock
from barchan.storage import write_text


def is_finished(store: FolderStore) -> bool:
    """Whether the run in the folder has been brought to its end."""
    return store.results_path.exists() and store.path(SUMMARY_FILE).exists()


def finish_folder(
    parameters: SceneParameters,
    scene_toml: str,
    store: FolderStore,
    clock: Clock,
    last_frame: int | None,
    progress: Progress,
    pictures: bool = True,
) -> Results:
    """Turn the frames 0 .. `last_frame` of a completed run into its final files; None: results.h5 is there already.

    Raises InputError for a damaged frame or a full disk.
    """
    if last_frame is not None:
        progress.note("writing results.h5")
        assemble(store, last_frame + 1, scene_toml, store.results_path)
    write_xdmf(store.results_path, store.path(XDMF_FILE))
    results = open_results(store.folder)
    if results.holds(MESH):
        write_fields(results, store.path(FIELDS_FILE))
    summary = full_summary(parameters, results, clock)
    if pictures:
        progress.note("drawing pictures")
        draw_pictures(parameters, results, summary, store.path(PICTURES_FOLDER))
    write_text(store.path(SUMMARY_FILE), json.dumps(_json_ready(summary), indent=2) + "\n")
    store.discard_work_files()
    return results


def write_fields(results: Results, path: Path) -> None:
    """The fields of the last frame of a run on a mesh, as a VTK file."""
    from barchan.results.fields import write_vtu
    from barchan.results.stored_meshes import mesh_from

    write_vtu(path, mesh_from(results.mesh), results.fields(-1))


def full_summary(parameters: SceneParameters, results: Results, clock: Clock) -> dict[str, Any]:
    """Figures of the run, with times, threads and versions."""
    return {
        "scene": parameters.scene.name,
        **find_kind(parameters.scene.kind).summarise(parameters, results),
        "seconds_total": clock.seconds,
        "seconds_per_step": clock.seconds_per_step,
        "threads": _threads(),
        "versions": _versions(),
    }


def draw_pictures(
    parameters: SceneParameters, results: Results, summary: dict[str, Any], folder: Path
) -> None:
    """The pictures of the kind of scene, in `folder`."""
    make_folder(folder)
    find_kind(parameters.scene.kind).draw(parameters, results, summary, folder)


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
