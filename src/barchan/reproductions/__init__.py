"""Published figures and tables, computed again: `barchan reproduce NAME` runs the scenes and shows both beside each other.

Each module has a TITLE and a function `reproduce(workshop) -> Report`; finished runs are kept in the folder of the
results, so an interrupted reproduction goes on where it was.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from barchan.errors import InputError
from barchan.reproductions.workshop import Report, Table, Workshop

NAMES = (
    "poiseuille",
    "bagnold",
    "beverloo",
    "silo_mu_i",
    "silo_fields",
    "cylinder",
    "solver_cost",
    "bingham_cavity",
    "cylinder_benchmark",
    "adaptive_newton",
    "continuation",
    "couette_solver",
    "couette_levels",
    "couette_regularisation",
    "couette_strategies",
    "heap_roundness",
    "column_law",
    "column_heights",
    "anisotropy",
    "column_profiles",
    "zhu_bridson",
    "silo_discharge",
    "tower_cohesion",
    "mpm_table",
    "mpm_solvers",
    "silo_p0",
    "column_law_p0",
    "rayleigh_taylor",
    "sedimentation",
    "sedimentation_onset",
    "immersed_columns",
    "grains_to_fields",
    "fibre_orbit",
    "local_solvers",
    "hair_solvers",
    "nodal_cloth",
)

__all__ = ["NAMES", "Report", "Table", "Workshop", "reproduce", "title"]


def title(name: str) -> str:
    """What a reproduction shows, in a line. Raises InputError for an unknown name."""
    return str(import_module(_module(name)).TITLE)


def reproduce(name: str, out: Path, quick: bool = False, processes: int = 2) -> Report:
    """Run a reproduction, or what is left of it, in the folder `out`.

    name : one of `NAMES`.  quick : fewer and coarser runs.  processes : how many scenes run at a time.

    Raises InputError for an unknown name, a folder that cannot be written, fewer than one process.
    """
    if processes < 1:
        raise InputError("processes", processes, "a whole number >= 1")
    module = import_module(_module(name))
    report = module.reproduce(Workshop(out, quick, processes))
    assert isinstance(report, Report)
    return report


def _module(name: str) -> str:
    if name not in NAMES:
        raise InputError("reproduction", name, "one of " + ", ".join(NAMES))
    return f"barchan.reproductions.{name}"
