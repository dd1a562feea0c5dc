"""Sparse linear algebra of the house: factorisations, block rows, colouring."""

from barchan.linalg.blocks import BlockRows, block_rows, diagonal_blocks_of_square
from barchan.linalg.colouring import Schedule, coloured_schedule, natural_schedule
from barchan.linalg.factor import Factor, factorise
from barchan.linalg.saddle import saddle_solver
from barchan.linalg.threads import one_blas_thread

__all__ = [
    "BlockRows",
    "Factor",
    "Schedule",
    "block_rows",
    "coloured_schedule",
    "diagonal_blocks_of_square",
    "factorise",
    "natural_schedule",
    "one_blas_thread",
    "saddle_solver",
]
