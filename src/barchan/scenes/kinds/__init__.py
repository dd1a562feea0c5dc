"""The kinds of scenes. Each is a module or package of this folder with a `KIND`, imported when a scene of it is loaded."""

from __future__ import annotations

from importlib import import_module

from barchan.errors import InputError
from barchan.scenes.kinds.kind import Kind

KIND_NAMES = (
    "column",
    "silo",
    "poiseuille",
    "bagnold",
    "cavity",
    "cylinder",
    "dense",
    "cylinder_dfg",
    "couette",
    "fluid_cavity",
    "sand",
    "dry_p0",
    "suspension",
    "bodies",
    "chain",
    "fibres",
    "cloth",
)
"""What `[scene] kind` may be; the first is the kind of a scene file that names none."""

__all__ = ["KIND_NAMES", "Kind", "find_kind"]


def find_kind(name: object) -> Kind:
    """The kind called `name`. Raises InputError listing the kinds when there is none."""
    if name not in KIND_NAMES:
        raise InputError("scene.kind", name, "one of " + ", ".join(repr(known) for known in KIND_NAMES))
    kind = import_module(f"barchan.scenes.kinds.{name}").KIND
    assert isinstance(kind, Kind)
    return kind
