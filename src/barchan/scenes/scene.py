"""A scene that can be run: `bc.scenes.load("collapse").run(out="runs/demo")`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from barchan.results import FolderStore, MemoryStore, Results, Store, claim_folder, results_in_memory
from barchan.results import open as open_results
from barchan.scenes.finish import finish_folder, full_summary, is_finished
from barchan.scenes.kinds import find_kind
from barchan.scenes.loading import load_parameters
from barchan.scenes.model import Model, WritesFiles
from barchan.scenes.parameters import SceneParameters
from barchan.scenes.progress import Progress, make_progress
from barchan.scenes.runner import Clock, clock_of, run_frames
from barchan.scenes.toml_text import to_toml


@dataclass(frozen=True)
class Run:
    """A finished run.

    observables : scalars over the frames, each of shape (frames,), `time` among them; of a finite-element run also
        what the last frame has along lines, each of shape (m,). SI units, or those of a dimensionless scene.
    summary : the figures of summary.json.
    folder : the run folder, or None when nothing was stored.
    results : every frame, see `barchan.results.Results`.
    already_finished : whether the folder held the finished run before, so that nothing was computed.
    """

    observables: dict[str, NDArray[Any]]
    summary: dict[str, Any]
    folder: Path | None
    results: Results
    already_finished: bool = False


class Scene:
    """Validated parameters and the way to run them.

    parameters : all parameters, one attribute per table of the TOML file (SI units).
    """

    def __init__(self, parameters: SceneParameters) -> None:
        self.parameters = parameters

    @property
    def name(self) -> str:
        """Short name of the scene."""
        return self.parameters.scene.name

    def toml(self) -> str:
        """The complete scene as TOML text, defaults included."""
        return to_toml(self.parameters)

    def model(self) -> Model[Any]:
        """The simulation behind the scene. Raises InputError when the flow rejects a parameter."""
        model: Model[Any] = find_kind(self.parameters.scene.kind).model(self.parameters)
        return model

    def run(
        self,
        out: str | Path | None = None,
        resume: bool = False,
        progress: bool = True,
        pictures: bool = True,
    ) -> Run:
        """Run the scene to its end.

        Parameters
        ----------
        out : run folder, new or empty (None: nothing is stored, frames stay in memory).
        resume : continue the run of the same scene stored in `out`; a finished one is returned as it is.
        progress : show progress on standard error.
        pictures : draw pictures at the end of a run in a folder.

        Raises
        ------
        InputError : for a folder that holds something else, a run of another scene, damaged or unwritable
            files;
            nothing already written is touched then.
        """
        parameters = self.parameters
        end = parameters.frame_count / parameters.frame_rate
        display = make_progress(self.name, end, progress, parameters.time_unit)
        model = self.model()  # first, so that a parameter the flow rejects leaves nothing on disk
        if out is None:
            return self._run_in_memory(model, display)
        with claim_folder(out, self.toml(), resume) as store:
            if is_finished(store):
                store.discard_work_files()
                results = open_results(store.folder)
                return Run(
                    observables_of(results), results.summary, store.folder, results, already_finished=True
                )
            return self._run_in_folder(model, store, display, pictures)

    def _run_in_folder(self, model: Model[Any], store: FolderStore, display: Progress, pictures: bool) -> Run:
        with display:
            if store.results_path.exists():  # killed after results.h5 was written: only the rest is missing
                clock, last = clock_of(store.checkpoint()), None
            else:
                if isinstance(model, WritesFiles):
                    model.folder = store.folder
                clock, last = self._run_frames(model, store, display)
            results = finish_folder(self.parameters, self.toml(), store, clock, last, display, pictures)
        return Run(observables_of(results), results.summary, store.folder, results)

    def _run_in_memory(self, model: Model[Any], display: Progress) -> Run:
        store = MemoryStore()
        with display:
            clock, _ = self._run_frames(model, store, display)
        results = results_in_memory(store, self.toml())
        return Run(observables_of(results), full_summary(self.parameters, results, clock), None, results)

    def _run_frames(self, model: Model[Any], store: Store, display: Progress) -> tuple[Clock, int]:
        parameters = self.parameters
        return run_frames(model, store, parameters.frame_rate, parameters.frame_count, display)


def observables_of(results: Results) -> dict[str, NDArray[Any]]:
    """The scalars of all frames, each (frames,), and what the last frame has along lines, each (m,)."""
    return {**results.observables, **(results.lines(-1) if results.holds("lines") else {})}


def load(scene: str | Path, /, **overrides: Any) -> Scene:
    """A scene by preset name ("collapse") or TOML file, with parameters overridden.

    Keys of `overrides` are bare when they stand in one table only (friction=0.5), have a double underscore
    (material__friction=0.5), are dotted (**{"material.friction": 0.5}) or name a table (material={"friction":
    0.5}). Raises InputError naming the field, its value and what is allowed.

    >>> load("collapse", friction=0.5).parameters.material.friction
    0.5
    """
    return Scene(load_parameters(scene, overrides))
