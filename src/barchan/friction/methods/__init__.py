"""Every method of the room, by name: a function (problem, recorder, r0, max_iterations, options...) in a module of its own.

`METHODS` is the only list: `solve`, the command line and the benchmarks read it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import NamedTuple

from barchan.friction.methods.aspg import aspg
from barchan.friction.methods.auto import auto
from barchan.friction.methods.gauss_seidel import gauss_seidel

FIRST_OPTION = 4


class Method(NamedTuple):
    """A way to solve a problem.

    run : the function.  source : where the literature has it.  idea : one line for tables.
    """

    run: Callable[..., None]
    source: str
    idea: str

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options it takes beyond (problem, recorder, r0, max_iterations)."""
        return tuple(inspect.signature(self.run).parameters)[FIRST_OPTION:]


METHODS: dict[str, Method] = {
    "auto": Method(auto, "this project", "portfolio of the others"),
    "gauss_seidel": Method(gauss_seidel, "seed B, Alg. 4.1", "exact block solves, swept"),
    "aspg": Method(aspg, "seed B, Alg. B.2", "accelerated spectral projected gradient"),
}
