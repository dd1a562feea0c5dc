"""Read a run back: `barchan.results.open("folder")`, finished or still under way.

One class over three sources that hold the same frames: results.h5, the frame files of an unfinished run, or
memory.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np

from barchan.errors import InputError
from barchan.results.assembly import FORMAT, TABLES, concatenate_steps, stack_observables
from barchan.results.frames import MESH, with_true_dimension
from barchan.results.sealed import Tree, read_image, read_tree, unseal
from barchan.results.store import (
    RESULTS_FILE,
    SCENE_FILE,
    SUMMARY_FILE,
    Store,
    count_frames,
    frame_path,
    read_toml,
)


class Source(Protocol):
    """Somewhere the frames of a run can be read from."""

    def frame_count(self) -> int:
        """Number of frames."""

    def groups(self) -> list[str]:
        """Names of the groups that the frames hold, and of the mesh if there is one."""

    def frame_group(self, index: int, group: str) -> Tree:
        """Arrays of a group of a frame; the mesh is that of frame 0."""

    def table(self, name: str) -> Tree:
        """Arrays of table "steps" or "observables"."""


class Results:
    """A run as numpy arrays.

    Attributes
    ----------
    folder : the run folder, or None for a run kept in memory.
    scene : the complete scene parameters, a nested dict as in scene.toml.
    finished : whether the run reached its end.
    """

    def __init__(self, source: Source, scene_toml: str, folder: Path | None, finished: bool) -> None:
        self._source = source
        self.scene: dict[str, Any] = tomllib.loads(scene_toml)
        self.folder = folder
        self.finished = finished

    @cached_property
    def frames(self) -> int:
        """Number of frames, the initial one included."""
        return self._source.frame_count()

    @property
    def times(self) -> np.ndarray:
        """Times of the frames (s), shape (frames,)."""
        return self.observables["time"]

    @cached_property
    def observables(self) -> dict[str, np.ndarray]:
        """Observables over the frames, each of shape (frames,), SI units."""
        return self._source.table("observables")

    @cached_property
    def steps(self) -> dict[str, np.ndarray]:
        """Records of the time steps, each of shape (steps,): time, dt, sweeps, residual, energies, ..."""
        return self._source.table("steps")

    def particles(self, frame: int) -> dict[str, np.ndarray]:
        """Particles of a frame (negative counts from the end): positions (P, d) m, velocities (P, d) m/s, volumes (P,).

        Positions and velocities are stored in single precision. Raises InputError for a frame that does not
        exist.
        """
        return self._group(frame, "particles")

    def grid(self, frame: int) -> dict[str, np.ndarray]:
        """Active nodes of a frame: node_ids (n,), positions (n, d), velocities (n, d), stresses (n, s) in Pa,
        chi coordinates, compression positive, pressures (n,) and shear_stresses (n,) in Pa, volume_fractions
        (n,), cells (c, 2^d) rows of node numbers.

        Raises InputError for a frame that does not exist.
        """
        return self._group(frame, "grid")

    @cached_property
    def mesh(self) -> dict[str, np.ndarray]:
        """The mesh of a finite-element run: positions (V, d) of the vertices, cells (c, corners) rows of vertex numbers.

        Raises InputError for a run without mesh.
        """
        return self._group(0, MESH)

    def fields(self, frame: int) -> dict[str, np.ndarray]:
        """Fields of a frame at the vertices of the mesh: velocities (V, d), stresses (V, s) in block coordinates,
        pressures, shear_stresses, shear_rates (V,), plug (V,), 1 where the material does not yield. In the units of
        the scene.

        Raises InputError for a frame that does not exist and for a run without mesh.
        """
        return self._group(frame, "fields")

    def lines(self, frame: int) -> dict[str, np.ndarray]:
        """Values of a frame sampled along lines, each (m,), named by the kind of scene (`profile_y`, `profile_ux`, ...).

        Raises InputError for a frame that does not exist and for a run without lines.
        """
        return self._group(frame, "lines")

    @property
    def summary(self) -> dict[str, Any]:
        """The contents of summary.json; empty until the run is finished."""
        path = None if self.folder is None else self.folder / SUMMARY_FILE
        return {} if path is None or not path.exists() else read_summary(path)

    def holds(self, group: str) -> bool:
        """Whether the frames have a group of that name ("particles", "grid", "mesh", "fields", "lines")."""
        return group in self._source.groups()

    def _group(self, frame: int, group: str) -> dict[str, np.ndarray]:
        """A group of a frame."""
        if not self.holds(group):
            raise InputError("group", group, "one of " + ", ".join(self._source.groups()) + " in this run")
        return self._source.frame_group(self._checked(frame), group)

    def _checked(self, frame: int) -> int:
        """Index counted from 0 of an existing frame."""
        index = frame + self.frames if frame < 0 else frame
        if not 0 <= index < self.frames:
            raise InputError("frame", frame, f"between 0 and {self.frames - 1}")
        return index


def open_results(folder: str | Path) -> Results:
    """Open a run folder, finished or not (public name: `barchan.results.open`).

    Raises InputError when it is not a run folder, has no frame yet, or a file of it is damaged.
    """
    folder = Path(folder)
    if not (folder / SCENE_FILE).is_file():
        raise InputError(str(folder), f"a folder without {SCENE_FILE}", "a barchan run folder")
    read_toml(folder / SCENE_FILE)
    scene_toml = (folder / SCENE_FILE).read_text(encoding="utf-8")
    path = folder / RESULTS_FILE
    if path.exists():
        source = _FinishedSource(path)
        return Results(source, scene_toml, folder, finished=True)
    if count_frames(folder) == 0:
        raise InputError(str(folder), "a run without frames", "a run that has written its first frame")
    images = _ImageSource(lambda index: read_image(frame_path(folder, index)), lambda: count_frames(folder))
    return Results(images, scene_toml, folder, finished=False)


def results_in_memory(store: Store, scene_toml: str) -> Results:
    """The results of a finished run kept in a store without a folder."""
    return Results(_ImageSource(store.frame_image, store.frame_count), scene_toml, None, finished=True)


def read_summary(path: Path) -> dict[str, Any]:
    """The contents of a summary.json. Raises InputError naming the file when it is damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"damaged ({error})", "a readable summary of a run") from error
    if not isinstance(content, dict):
        raise InputError(str(path), type(content).__name__, "a summary of a run")
    return content


@contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """The open results.h5 at `path`; whatever HDF5 finds wrong with it becomes an InputError naming it."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, RuntimeError) as error:
        raise InputError(str(path), f"damaged ({error})", "an intact file of a barchan run") from error


class _FinishedSource:
    """results.h5."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with reading(self._path) as file:
            if bytes(file.attrs.get("format", b"")).decode(errors="replace") != FORMAT:
                raise InputError(str(path), "a foreign HDF5 file", f"in the format {FORMAT!r}")

    def frame_count(self) -> int:
        with reading(self._path) as file:
            return len(file["frames"])

    def groups(self) -> list[str]:
        with reading(self._path) as file:
            return [*file["frames/00000"], *([MESH] if MESH in file else [])]

    def frame_group(self, index: int, group: str) -> Tree:
        with reading(self._path) as file:
            place = MESH if group == MESH else f"frames/{index:05d}/{group}"
            return with_true_dimension(read_tree(file[place]), int(file.attrs["dimension"]))

    def table(self, name: str) -> Tree:
        with reading(self._path) as file:
            return read_tree(file[name])


class _ImageSource:
    """Sealed frame images: of a run in memory, or the frame files of an unfinished run (read without locking)."""

    def __init__(self, image: Callable[[int], bytes], count: Callable[[], int]) -> None:
        self._image = image
        self.frame_count = count

    def groups(self) -> list[str]:
        return [name for name in unseal(self._image(0)) if name not in TABLES]

    def frame_group(self, index: int, group: str) -> Tree:
        frame = unseal(self._image(0 if group == MESH else index))
        return with_true_dimension(frame[group], int(frame["dimension"]))

    def table(self, name: str) -> Tree:
        parts = [self.frame_group(index, name) for index in range(self.frame_count())]
        return concatenate_steps(parts) if name == "steps" else stack_observables(parts)
