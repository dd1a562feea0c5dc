"""Where the frames and the checkpoint of a run are kept while it runs: a run folder, or memory.

Protocol that makes `kill -9` harmless: frame k is written atomically, then the checkpoint that follows frame
k, and only then does the run go on. Resuming from checkpoint k rewrites frame k+1 and later with the same
bytes.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

from barchan.errors import InputError
from barchan.results.sealed import Tree, read_image, read_sealed, seal, write_sealed
from barchan.storage import TEMPORARY_MARK, remove_partial_files, unwritable, write_text

SCENE_FILE = "scene.toml"
RESULTS_FILE = "results.h5"
SUMMARY_FILE = "summary.json"
CHECKPOINT_FILE = "checkpoint.h5"
XDMF_FILE = "results.xdmf"
FIELDS_FILE = "fields.vtu"
FRAMES_FOLDER = "frames"
PICTURES_FOLDER = "pictures"


class Store(Protocol):
    """Frames 0, 1, 2, ... of a run, as sealed images, and its latest checkpoint."""

    def put_frame(self, index: int, tree: Mapping[str, Any]) -> None:
        """Keep frame `index` (nested dict of arrays); an existing frame of that index is replaced."""

    def frame_image(self, index: int) -> bytes:
        """The sealed image of a frame, checked to be intact."""

    def frame_name(self, index: int) -> str:
        """Where frame `index` is or would be, for messages."""

    def frame_count(self) -> int:
        """Number of frames kept, counted from frame 0 without a gap."""

    def put_checkpoint(self, tree: Mapping[str, Any]) -> None:
        """Keep the complete state after the latest frame."""

    def checkpoint(self) -> Tree | None:
        """The latest checkpoint, or None before the first one."""


class MemoryStore:
    """A store that leaves nothing on disk (frames compressed in memory, no checkpoint kept)."""

    def __init__(self) -> None:
        self._images: list[bytes] = []

    def put_frame(self, index: int, tree: Mapping[str, Any]) -> None:
        """Keep frame `index`, dropping any later one."""
        self._images[index:] = [seal(tree)]

    def frame_image(self, index: int) -> bytes:
        """The sealed image of a frame."""
        return self._images[index]

    def frame_name(self, index: int) -> str:
        """Frames have no file."""
        return f"frame {index} in memory"

    def frame_count(self) -> int:
        """Number of frames kept."""
        return len(self._images)

    def put_checkpoint(self, tree: Mapping[str, Any]) -> None:
        """Nothing to do: a run in memory cannot be resumed."""

    def checkpoint(self) -> Tree | None:
        """Always None."""
        return None


class FolderStore:
    """The run folder: scene.toml, frames/frame_00012.h5, checkpoint.h5, and at the end results.h5.

    Create it with `claim_folder`. While it is open the folder is locked against a second run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = _lock(folder)

    @property
    def results_path(self) -> Path:
        """results.h5, present once the run has reached its end."""
        return self.folder / RESULTS_FILE

    def path(self, name: str) -> Path:
        """A file of the run folder by name."""
        return self.folder / name

    def put_frame(self, index: int, tree: Mapping[str, Any]) -> None:
        """Write frame `index` atomically."""
        make_folder(self.folder / FRAMES_FOLDER)
        write_sealed(frame_path(self.folder, index), tree)

    def frame_image(self, index: int) -> bytes:
        """The bytes of a frame file; InputError naming it when it is missing or damaged."""
        return read_image(frame_path(self.folder, index))

    def frame_name(self, index: int) -> str:
        """The file of frame `index`."""
        return str(frame_path(self.folder, index))

    def frame_count(self) -> int:
        """Number of frame files from frame 0 without a gap."""
        return count_frames(self.folder)

    def put_checkpoint(self, tree: Mapping[str, Any]) -> None:
        """Replace checkpoint.h5 atomically."""
        write_sealed(self.folder / CHECKPOINT_FILE, tree)

    def checkpoint(self) -> Tree | None:
        """The latest checkpoint or None; InputError naming the file when it is damaged or lost."""
        path = self.folder / CHECKPOINT_FILE
        if path.exists():
            return read_sealed(path)
        if self.frame_count() > 1:
            raise InputError(str(path), "missing", "there to resume a run that has frames")
        return None

    def discard_work_files(self) -> None:
        """Remove frames and checkpoint; only called once results.h5 is in place."""
        for path in sorted((self.folder / FRAMES_FOLDER).glob("frame_*.h5")):
            path.unlink()
        if (self.folder / FRAMES_FOLDER).is_dir():
            remove_partial_files(self.folder / FRAMES_FOLDER)
            (self.folder / FRAMES_FOLDER).rmdir()
        (self.folder / CHECKPOINT_FILE).unlink(missing_ok=True)

    def close(self) -> None:
        """Release the lock on the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> FolderStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def claim_folder(folder: str | Path, scene_toml: str, resume: bool = False) -> FolderStore:
    """Open `folder` for a run of the scene whose complete TOML text is `scene_toml`.

    A new or empty folder becomes a run folder (scene.toml is written first). A run folder of the same scene
    is opened only with `resume`. Raises InputError, with nothing changed on disk, for a folder that holds
    other things, a run folder without `resume`, a run folder of a different scene, a folder in use, or an
    unwritable place.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(str(folder), "a file", "a folder")
    contents = _contents(folder)
    scene_path = folder / SCENE_FILE
    if contents and scene_path not in contents:
        raise InputError(
            str(folder),
            f"a folder with other contents ({min(path.name for path in contents)}, ...)",
            "a new or empty folder, or a barchan run folder (nothing was touched)",
        )
    if contents and not resume:
        raise InputError(
            str(folder),
            "a folder with a run in it",
            "a new or empty folder; to continue that run, or show it if finished, resume it (--resume)",
        )
    if contents:
        _require_same_scene(scene_path, scene_toml)
    make_folder(folder)
    with ExitStack() as stack:
        store = stack.enter_context(FolderStore(folder))
        for place in (folder, folder / FRAMES_FOLDER, folder / PICTURES_FOLDER):
            remove_partial_files(place)
        if not contents:
            write_text(scene_path, scene_toml)
        stack.pop_all()  # all went well: the lock is now the caller's
    return store


def make_folder(folder: Path) -> None:
    """Create a folder and its parents. Raises InputError when that is not allowed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error


def frame_path(folder: Path, index: int) -> Path:
    """File of frame `index` in a run folder."""
    return folder / FRAMES_FOLDER / f"frame_{index:05d}.h5"


def count_frames(folder: Path) -> int:
    """Number of frame files in a run folder, from frame 0 without a gap."""
    count = 0
    while frame_path(folder, count).exists():
        count += 1
    return count


def _contents(folder: Path) -> set[Path]:
    """What is in the folder, apart from leftovers of a process killed while it wrote its first file."""
    if not folder.exists():
        return set()
    try:
        return {path for path in folder.iterdir() if not path.name.endswith(TEMPORARY_MARK)}
    except OSError as error:
        raise unwritable(folder, error) from error


def _require_same_scene(scene_path: Path, scene_toml: str) -> None:
    """Raise InputError naming the first parameter in which the stored scene differs from the requested one."""
    stored = read_toml(scene_path)
    requested = tomllib.loads(scene_toml)
    difference = _first_difference(stored, requested)
    if difference is None:
        return
    key, before, now = difference
    raise InputError(key, _shown(now), f"{_shown(before)} as in {scene_path} (a resumed run keeps its scene)")


def _shown(value: Any) -> str:
    return "left out" if value is None else repr(value)


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dict. Raises InputError naming the file when it is missing or not TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), f"not readable ({error.strerror})", "a TOML file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"not TOML ({error})", "a valid TOML file") from error


def _first_difference(stored: Any, requested: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """(dotted key, stored value, requested value) of the first difference between two TOML documents."""
    if isinstance(stored, dict) and isinstance(requested, dict):
        for name in [*stored, *(name for name in requested if name not in stored)]:
            below = f"{key}.{name}" if key else name
            found = _first_difference(stored.get(name), requested.get(name), below)
            if found is not None:
                return found
        return None
    return None if stored == requested else (key, stored, requested)


def _lock(folder: Path) -> int | None:
    """Lock the folder itself against a second run (the lock dies with the process); None where unsupported."""
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise InputError(str(folder), "in use", "a folder that no other barchan process writes to") from error
    except OSError:  # a file system without locks: go on without one
        os.close(descriptor)
        return None
    return descriptor
