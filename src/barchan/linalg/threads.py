"""One pool of threads at a time: BLAS stays on one thread while the house's own kernels use them all.

Two pools that both spin on the same cores slow each other down by an order of magnitude; and a BLAS on one thread gives
sums that do not depend on the number of threads.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[object]:
    """Context in which BLAS calls of NumPy and SciPy run on the calling thread."""
    return _controller().limit(limits=1, user_api="blas")
