"""Sparse linear algebra of the house: factorisations, block rows, colouring."""

from barchan.linalg.blocks import BlockRows, block_rows, diagonal_blocks_of_square, transposed_product
from barchan.linalg.colouring import Schedule, coloured_schedule, natural_schedule
from barchan.linalg.delassus import delassus_diagonal, delassus_trace
from barchan.linalg.factor import Factor, factorise
from barchan.linalg.gram import GramPattern
from barchan.linalg.krylov import KrylovSolver, solver_for
from barchan.linalg.pattern_solver import PatternSolver
from barchan.linalg.saddle import Saddle, saddle_solver
from barchan.linalg.threads import one_blas_thread

__all__ = [
    "BlockRows",
    "Factor",
    "GramPattern",
    "KrylovSolver",
    "PatternSolver",
    "Saddle",
    "Schedule",
    "block_rows",
    "coloured_schedule",
    "delassus_diagonal",
    "delassus_trace",
    "diagonal_blocks_of_square",
    "factorise",
    "natural_schedule",
    "one_blas_thread",
    "saddle_solver",
    "solver_for",
    "transposed_product",
]
