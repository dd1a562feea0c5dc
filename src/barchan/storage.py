"""Files that are either wholly there or not there: write to a temporary neighbour, flush to disk, rename.

A kill at any moment leaves the old file or the new one, never half of one. Every file the house writes, in run folders and
elsewhere, goes through here (DESIGN: "nothing already written is damaged").
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from barchan.errors import InputError

TEMPORARY_MARK = ".barchan-partial"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; on success flush it to disk and rename it over `path`.

    The temporary name holds the number of the process, so that two processes writing the same file do not mix.

    Raises
    ------
    InputError : `path` is a folder, or the system refuses to write there (no such folder, permissions, full disk). If the
        block fails or the process dies, `path` keeps its former content.
    """
    if path.is_dir():
        raise InputError(str(path), "a folder", "a file name")
    if not path.parent.is_dir():
        raise InputError(str(path), "not writable (no such folder)", "in a folder that can be written")
    temporary = path.with_name(f"{path.name}.{os.getpid()}{TEMPORARY_MARK}")
    try:
        yield temporary
        _flush(temporary)
        os.replace(temporary, path)
        _flush(path.parent)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):  # a folder that cannot be written holds nothing to discard
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Replace the content of `path` atomically. Raises InputError when it cannot be written."""
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(content)


def write_text(path: Path, content: str) -> None:
    """Replace the content of `path` (UTF-8) atomically. Raises InputError when it cannot be written."""
    write_bytes(path, content.encode("utf-8"))


def unwritable(path: Path, error: OSError) -> InputError:
    """The error for a path that the system refuses to create or write."""
    reason = (
        os.strerror(error.errno) if error.errno else str(error)
    )  # HDF5's own text would name the temporary file
    return InputError(str(path), f"not writable ({reason})", "in a folder that can be written")


def remove_partial_files(folder: Path) -> None:
    """Delete what a killed process left half written in `folder` (not recursive)."""
    for leftover in folder.glob("*" + TEMPORARY_MARK):
        leftover.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """fsync of a file, or of a folder so that a rename in it survives a power cut."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
