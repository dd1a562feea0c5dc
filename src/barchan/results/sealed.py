"""Small HDF5 files that know whether they are intact: frames and checkpoints of a run.

A sealed file is a deterministic HDF5 image whose 512-byte user block holds the SHA-256 of the rest, so any
truncation or flipped bit is found before a single number is used. Other HDF5 tools read it as usual.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from barchan.errors import InputError
from barchan.storage import write_bytes

Tree = dict[str, Any]
"""Nested dict: names -> numpy arrays (leaves) or further dicts (groups)."""

_USER_BLOCK = 512
_MAGIC = b"barchan sealed 1\n"
_COMPRESS_FROM = 256  # bytes; smaller datasets are stored as they are


def seal(tree: Mapping[str, Any]) -> bytes:
    """Image of a sealed file holding `tree` (nested dict of arrays). The same tree gives the same bytes."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v108", "v108"), userblock_size=_USER_BLOCK) as file:
        write_tree(file, tree)
    body = buffer.getvalue()[_USER_BLOCK:]
    head = _MAGIC + hashlib.sha256(body).digest()
    return head.ljust(_USER_BLOCK, b"\0") + body


def unseal(image: bytes) -> Tree:
    """Nested dict of the arrays in an intact sealed image."""
    with h5py.File(io.BytesIO(image), "r") as file:
        return read_tree(file)


def write_sealed(path: Path, tree: Mapping[str, Any]) -> None:
    """Write `tree` to a sealed file, atomically. Raises InputError when the folder cannot be written."""
    write_bytes(path, seal(tree))


def read_sealed(path: Path) -> Tree:
    """Read a sealed file. Raises InputError naming it when it is missing, truncated, altered or foreign."""
    return unseal(read_image(path))


def read_image(path: Path) -> bytes:
    """The bytes of a sealed file. Raises InputError naming it unless they are exactly what `seal` produced."""
    try:
        image = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"not readable ({error.strerror})", "a file of a barchan run") from error
    digest = image[len(_MAGIC) : len(_MAGIC) + 32]
    if not image.startswith(_MAGIC) or hashlib.sha256(image[_USER_BLOCK:]).digest() != digest:
        raise InputError(str(path), "truncated, altered or foreign", "an intact file of a barchan run")
    return image


def write_tree(group: h5py.Group, tree: Mapping[str, Any]) -> None:
    """Write nested dicts of arrays below an HDF5 group: no time stamps, large arrays shuffled and deflated."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            write_tree(group.create_group(name), value)
            continue
        array = np.asarray(value)
        packed = array.nbytes >= _COMPRESS_FROM
        options = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if packed else {}
        group.create_dataset(name, data=array, track_times=False, **options)


def read_tree(group: h5py.Group) -> Tree:
    """Nested dict of everything below an HDF5 group."""
    return {
        name: read_tree(item) if isinstance(item, h5py.Group) else item[()] for name, item in group.items()
    }
