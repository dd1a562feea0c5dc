"""One-block solvers: exact secular equation (any s), enumeration of a quartic (s = 2, 3), Fischer-Burmeister Newton (any s).

Seed B 4.1.1-4.1.2 and Appendix B.1. All share one meaning: given W (s, s) and b (s,), find r with (W r + b, r) in the law.
"""

from __future__ import annotations

import numpy as np

from barchan.cones import Law
from barchan.errors import InputError
from barchan.friction.local._dispatch import (
    ENUMERATIVE,
    FISCHER_BURMEISTER,
    HYBRID,
    SECULAR,
    scratch,
    solve_block_kernel,
)
from barchan.friction.local._secular import prepare

LOCAL_SOLVERS: dict[str, int] = {
    "secular": SECULAR,
    "enumerative": ENUMERATIVE,
    "fischer-burmeister": FISCHER_BURMEISTER,
    "hybrid": HYBRID,
}


def local_code(name: str, s: int, parameters: np.ndarray) -> int:
    """Kernel code of a local solver, checked against block size and law.

    Raises
    ------
    InputError : unknown name, enumeration asked for s > 3, or a yield stress given to a solver that needs a plain cone.
    """
    if name not in LOCAL_SOLVERS:
        raise InputError("local_solver", name, "one of " + ", ".join(sorted(LOCAL_SOLVERS)))
    if name in ("enumerative", "hybrid") and s > 3:
        raise InputError(
            "local_solver", name, f"'secular' or 'fischer-burmeister' for blocks of size {s} > 3"
        )
    if name != "secular" and (parameters[:, 1:3] != 0.0).any():
        raise InputError("local_solver", name, "'secular' for laws with a shear or tensile yield stress")
    return LOCAL_SOLVERS[name]


def solve_block(
    law: Law, W: np.ndarray, b: np.ndarray, method: str = "secular", r0: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Solve one block: find r, u = W r + b with (u, r) in `law` (first block's parameters).

    Parameters
    ----------
    W : (s, s) symmetric positive definite.  b : (s,).  r0 : (s,) start of the Newton methods.

    Returns
    -------
    r, u : (s,) each.
    """
    W = np.ascontiguousarray(W, dtype=float)
    b = np.ascontiguousarray(b, dtype=float)
    s = len(b)
    parameters = law.parameters(1)
    code = local_code(method, s, parameters)
    r = np.zeros(s) if r0 is None else np.array(r0, dtype=float)
    solve_block_kernel(s, code, W, prepare(W[None])[0], b, parameters[0], 0.0, r, *scratch(s))
    return r, W @ r + b


__all__ = ["LOCAL_SOLVERS", "local_code", "prepare", "solve_block"]
