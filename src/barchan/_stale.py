"""Removes compiled kernels that a change of source has made stale.

Numba checks a cached kernel against its own file only; a kernel that calls another file's function would keep the old
machine code inlined. Whenever any kernel source is newer than a cached index, that index is dropped and rebuilt.
"""

from __future__ import annotations

import contextlib
from pathlib import Path


def drop_stale_kernels(package: Path) -> int:
    """Delete the Numba indices below `package` older than the newest source that holds a kernel; returns how many."""
    newest = max((p.stat().st_mtime for p in package.rglob("*.py") if b"njit" in p.read_bytes()), default=0.0)
    dropped = 0
    for index in package.rglob("__pycache__/*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime < newest:
                index.unlink()
                dropped += 1
    return dropped
