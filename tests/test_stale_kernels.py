"""A cached kernel older than any kernel source is dropped, a younger one is kept."""

from __future__ import annotations

import os
from pathlib import Path

from barchan._stale import drop_stale_kernels


def test_only_stale_indices_go(tmp_path: Path) -> None:
    source = tmp_path / "_kernels.py"
    source.write_text("from numba import njit\n")
    plain = tmp_path / "plain.py"
    plain.write_text("x = 1\n")
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    old, young = cache / "a.nbi", cache / "b.nbi"
    for path in (old, young):
        path.write_bytes(b"")
    os.utime(source, (1000, 1000))
    os.utime(plain, (3000, 3000))
    os.utime(old, (999, 999))
    os.utime(young, (1001, 1001))
    assert drop_stale_kernels(tmp_path) == 1
    assert young.exists() and not old.exists()
