"""Files that appear whole or not at all, for every writer of problem files.

The new content is written beside its place, brought to the disk, and moved over the old one in one step.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from barchan.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path in the folder of `path`; move it to `path` if the block ends without an error.

    Raises
    ------
    InputError : the folder is missing or the file cannot be written; an older file at `path` is left as it
        was.
    """
    if path.is_dir():
        raise InputError(str(path), "a folder", "a file name")
    if not path.parent.is_dir():
        raise InputError(str(path), "no such folder", "a file in a folder that exists")
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield draft
        with draft.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(draft, path)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "a file that can be written") from error
    finally:
        draft.unlink(missing_ok=True)
