"""barchan: dry friction between bodies and yielding inside a granular continuum as one discrete problem.

The rooms below are imported on first use, so that `import barchan` costs nothing:

    >>> import barchan as bc
    >>> bc.errors.InputError.__name__
    'InputError'
"""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from barchan._stale import drop_stale_kernels

if TYPE_CHECKING:
    from barchan import bench, cones, errors, flows, friction, linalg, results, scenes, spaces, storage

__version__ = "0.1.0"

_ROOMS = ("errors", "storage", "cones", "linalg", "friction", "spaces", "flows", "results", "scenes", "bench")

drop_stale_kernels(Path(__file__).parent)

__all__ = [
    "__version__",
    "bench",
    "cones",
    "errors",
    "flows",
    "friction",
    "linalg",
    "results",
    "scenes",
    "spaces",
    "storage",
]


def __getattr__(name: str) -> ModuleType:
    """Import a room the first time it is asked for (PEP 562)."""
    if name not in _ROOMS:
        raise AttributeError(f"module 'barchan' has no attribute {name!r}")
    return importlib.import_module(f"barchan.{name}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOMS})
