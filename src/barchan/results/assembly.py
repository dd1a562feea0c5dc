"""results.h5 of a finished run, assembled from the frame images in one deterministic pass.

Layout: /frames/00012/<group>/<array>, /mesh/<array> of a run on a mesh, /observables/<name> (frames,),
/steps/<name> (steps,), and the attributes `format`, `dimension` and `scene` (complete TOML); see frames.py for the
groups. It holds no wall-clock figure, host name or date, so an uninterrupted run and one killed and resumed give the same
bytes.
"""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import numpy as np

from barchan.results.frames import MESH
from barchan.results.sealed import read_tree, write_tree
from barchan.results.store import Store
from barchan.storage import replacing

FORMAT = "barchan results 1"
TABLES = ("dimension", "steps", "observables")


def assemble(store: Store, frame_count: int, scene_toml: str, path: Path) -> None:
    """Write results.h5 from frames 0 .. frame_count - 1 of `store`, atomically.

    Raises InputError naming the frame that is missing or damaged; `path` is then left as it was.
    """
    steps: list[dict[str, np.ndarray]] = []
    observables: list[dict[str, np.ndarray]] = []
    with replacing(path) as temporary, h5py.File(temporary, "w", libver=("v108", "v108")) as target:
        target.attrs["format"] = np.bytes_(FORMAT.encode())
        target.attrs["scene"] = np.bytes_(scene_toml.encode("utf-8"))
        frames = target.create_group("frames")
        for index in range(frame_count):
            with h5py.File(io.BytesIO(store.frame_image(index)), "r") as source:
                group = frames.create_group(f"{index:05d}")
                for name in sorted(
                    source, reverse=True
                ):  # particles before grid: the order shows in the bytes
                    if name not in TABLES:
                        source.copy(name, target if name == MESH else group)
                target.attrs["dimension"] = source["dimension"][()]
                steps.append(read_tree(source["steps"]))
                observables.append(read_tree(source["observables"]))
        write_tree(target.create_group("observables"), stack_observables(observables))
        write_tree(target.create_group("steps"), concatenate_steps(steps))


def stack_observables(frames: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Scalars of each frame -> one array of shape (frames,) per observable."""
    return {name: np.array([frame[name] for frame in frames]) for name in (frames[0] if frames else {})}


def concatenate_steps(frames: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Step records of each frame -> one array of shape (steps,) per record field."""
    names = next((list(frame) for frame in frames if frame), [])
    return {name: np.concatenate([frame[name] for frame in frames if frame]) for name in names}
