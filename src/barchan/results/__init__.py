"""Storage of runs: crash-safe run folders, results.h5, XDMF for ParaView, pictures and animation.

    >>> import barchan as bc
    >>> results = bc.results.open("runs/collapse-1")        # doctest: +SKIP
    >>> results.particles(-1)["positions"].shape             # doctest: +SKIP

Pictures (`barchan.results.pictures`, `barchan.results.animation`) are imported only when drawn: matplotlib is
slow.
"""

from barchan.results.assembly import assemble
from barchan.results.frames import frame_tree, step_table
from barchan.results.reader import Results, read_summary, results_in_memory
from barchan.results.reader import open_results as open
from barchan.results.store import FolderStore, MemoryStore, Store, claim_folder
from barchan.results.xdmf import write_xdmf

__all__ = [
    "FolderStore",
    "MemoryStore",
    "Results",
    "Store",
    "assemble",
    "claim_folder",
    "frame_tree",
    "open",
    "read_summary",
    "results_in_memory",
    "step_table",
    "write_xdmf",
]
