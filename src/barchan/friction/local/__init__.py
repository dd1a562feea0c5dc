"""One-block solvers (seed B 4.1.1-4.1.2, 4.2.3, B.1): given W (s, s) and b (s,), find r with (W r + b, r) in the law.

Exact secular equation (any size and law), enumeration of a quartic (s = 2, 3), Newton on the functions of Fischer-Burmeister
and of Alart-Curnier (pure, damped), fixed point of Duriez, and the four-sided pyramid, which solves another law. The last five
also with a fail-safe: "<name>+enumerative" (Table 4.3) or "<name>+secular".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.cones import Law
from barchan.errors import InputError
from barchan.friction.local._decompose import local_blocks
from barchan.friction.local._dispatch import (
    ALART_CURNIER,
    ALART_CURNIER_DAMPED,
    DURIEZ,
    ENUMERATIVE,
    FACETED,
    FAILED,
    FISCHER_BURMEISTER,
    PYRAMID,
    SECULAR,
    THEN_ENUMERATIVE,
    THEN_SECULAR,
    USED_FAILSAFE,
    scratch,
    solve_block_kernel,
)

_PRIMARY = {
    "pyramid": PYRAMID,
    "duriez": DURIEZ,
    "alart-curnier": ALART_CURNIER,
    "alart-curnier-damped": ALART_CURNIER_DAMPED,
    "fischer-burmeister": FISCHER_BURMEISTER,
}
LOCAL_SOLVERS: dict[str, int] = {
    "secular": SECULAR,
    **_PRIMARY,
    "enumerative": ENUMERATIVE,
    **{f"{name}+enumerative": code + THEN_ENUMERATIVE for name, code in _PRIMARY.items()},
    **{f"{name}+secular": code + THEN_SECULAR for name, code in _PRIMARY.items()},
}
# The solver of `FacetedCoulomb`; not among the others, which solve round laws.
FACETED_SOLVER = "faceted"


@dataclass
class LocalCounts:
    """What the local solves of a run came to (the columns of seed B, Table 4.3); added to by each run it is given to.

    solves : block solves.  failures : answers whose local certificate exceeds `LOCAL_TOLERANCE` (for the pyramid alone:
    blocks without any answer of its own law).  failsafe_calls : answers of the primary solver that were handed on.
    """

    solves: int = 0
    failures: int = 0
    failsafe_calls: int = 0


@dataclass(frozen=True)
class BlockAnswer:
    """How one block was solved: r, u = W r + b, each (s,); whether it failed, and whether the fail-safe was called."""

    r: np.ndarray
    u: np.ndarray
    failed: bool
    used_failsafe: bool


def local_code(name: str, s: int, parameters: np.ndarray) -> int:
    """Kernel code of a local solver, checked against block size and law.

    Raises
    ------
    InputError : unknown name, enumeration asked for s > 3, or a yield stress given to a solver that needs a plain cone.
    """
    if name == FACETED_SOLVER:
        return FACETED
    if name not in LOCAL_SOLVERS:
        raise InputError("local_solver", name, "one of " + ", ".join(sorted(LOCAL_SOLVERS)))
    if name.endswith("enumerative") and s > 3:
        suited = name.replace("enumerative", "secular")
        raise InputError(
            "local_solver", name, f"'{suited}', for example, since blocks of size {s} > 3 have no enumeration"
        )
    if name != "secular" and (parameters[:, 1:3] != 0.0).any():
        raise InputError("local_solver", name, "'secular' for laws with a shear or tensile yield stress")
    return LOCAL_SOLVERS[name]


def answer_block(
    law: Law, W: np.ndarray, b: np.ndarray, method: str = "secular", r0: np.ndarray | None = None
) -> BlockAnswer:
    """Solve one block and tell how: find r, u = W r + b with (u, r) in `law` (first block's parameters).

    Parameters
    ----------
    W : (s, s) symmetric positive definite.  b : (s,); a pyramid is aligned with its tangential part.
    r0 : (s,) start of the iterative methods.

    Raises
    ------
    InputError : as `local_code`.
    """
    W = np.ascontiguousarray(W, dtype=float)
    b = np.ascontiguousarray(b, dtype=float)
    s = len(b)
    parameters = law.parameters(1)
    code = local_code(method, s, parameters)
    r = np.zeros(s) if r0 is None else np.array(r0, dtype=float)
    status = solve_block_kernel(s, code, W, local_blocks(W[None])[1][0], b, b, parameters[0], r, *scratch(s))
    return BlockAnswer(r, W @ r + b, bool(status & FAILED), bool(status & USED_FAILSAFE))


def solve_block(
    law: Law, W: np.ndarray, b: np.ndarray, method: str = "secular", r0: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(r, u), each (s,), of `answer_block`; same parameters and errors."""
    answer = answer_block(law, W, b, method, r0)
    return answer.r, answer.u


__all__ = [
    "FACETED_SOLVER",
    "LOCAL_SOLVERS",
    "BlockAnswer",
    "LocalCounts",
    "answer_block",
    "local_blocks",
    "local_code",
    "solve_block",
]
