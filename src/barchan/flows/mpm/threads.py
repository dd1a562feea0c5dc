"""How many threads a step's kernels use: one where waking the others costs more than it saves.

Every kernel gives the same bytes on any number of threads, so this changes times only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba

# Below this many particles a parallel region takes a fraction of a millisecond, and several when the cores are shared.
PARALLEL_PARTICLES = 15_000


@contextmanager
def threads_for(particles: int) -> Iterator[None]:
    """Within this context kernels run on one thread if there are few particles, else on all that Numba may use."""
    before = numba.get_num_threads()
    if particles < PARALLEL_PARTICLES:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
