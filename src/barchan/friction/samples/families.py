"""Named sets of made-to-measure problems for tests, comparisons and performance profiles.

Seed B Table 4.3 compares local solvers over many problems; here the ratio n d / m, friction, block size and origin vary.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from barchan.errors import InputError
from barchan.friction.problem import Problem
from barchan.friction.samples.known import sample
from barchan.friction.samples.piles import pile

Named = tuple[str, Problem]
RATIOS = (0.1, 0.3, 1.0, 3.0, 10.0)
FRICTIONS: tuple[float | tuple[float, float], ...] = (0.0, 0.3, (0.0, 1.5))
SIZES = (2, 3, 6)
CONDITIONS = (1.0, 10.0, 1e3)
TABLE_SAMPLES, TABLE_PILES = 90, 30


def family(name: str = "small", seed: int = 0) -> list[Named]:
    """Problems of a family, each with a name that tells how it was made.

    Parameters
    ----------
    name : "small", 54 problems of 8 to 60 contacts, s = 2, 3, 6, for tests; "table", 120 problems of 10 to 200 contacts,
        s = 3, for comparisons of solvers; "unsolvable", 9 small problems that have no solution.
    seed : of the whole family.

    Raises
    ------
    InputError : unknown family.
    """
    if name not in FAMILIES:
        raise InputError("family", name, "one of " + ", ".join(FAMILIES))
    return list(FAMILIES[name](seed))


def _seeds(seed: int) -> Iterator[int]:
    """Independent seeds derived from one."""
    rng = np.random.default_rng(seed)
    while True:
        yield int(rng.integers(2**31))


def _mu_text(mu: float | tuple[float, float]) -> str:
    return f"mu{mu[0]:g}-{mu[1]:g}" if isinstance(mu, tuple) else f"mu{mu:g}"


def _small(seed: int) -> Iterator[Named]:
    """45 samples over ratio, friction and size; one with constraints for each size and two ratios; three piles."""
    seeds = _seeds(seed)
    for number, (ratio, mu, s) in enumerate(product(RATIOS, FRICTIONS, SIZES)):
        n = 30 if ratio >= 1.0 else 8
        made = sample(n, s, ratio, mu, next(seeds), condition=CONDITIONS[number % 3])
        yield f"s{s}-ratio{ratio:g}-{_mu_text(mu)}", made.problem
    for s, ratio in product(SIZES, (0.3, 3.0)):
        n = 30 if ratio >= 1.0 else 8
        yield f"s{s}-ratio{ratio:g}-constrained", sample(n, s, ratio, 0.5, next(seeds), constraints=5).problem
    yield "pile-2d", pile(20, next(seeds), 0.5, dimension=2).problem
    yield "pile-3d", pile(12, next(seeds), 0.5, speed=0.05).problem
    yield "pile-3d-uneven", pile(12, next(seeds), (0.1, 0.9), jitter=0.02, uneven=True).problem


def _table(seed: int) -> Iterator[Named]:
    """Samples of random size, ratio and friction, and piles at rest, settling and thrown."""
    seeds = _seeds(seed)
    rng = np.random.default_rng(next(seeds))
    for number in range(TABLE_SAMPLES):
        n = round(10.0 * 20.0 ** rng.random())
        ratio = min(10.0 ** rng.uniform(-1.0, 1.0), float(n))
        mu = (0.0, 0.3, 0.8, 1.5, (0.0, 1.5))[number % 5]
        made = sample(n, 3, ratio, mu, next(seeds), condition=CONDITIONS[number % 3])
        yield f"sample-{number:02}-n{n}-ratio{ratio:.2g}-{_mu_text(mu)}", made.problem
    for number in range(TABLE_PILES):
        bodies = round(4.0 * 10.0 ** rng.random())
        mu = (0.2, 0.5, 0.8, 1.2, (0.0, 1.5))[number % 5]
        state = ({"closed": True}, {"spread": 0.02}, {"speed": 0.1})[number % 3]
        made_pile = pile(bodies, next(seeds), mu, uneven=number % 2 == 1, **state)
        yield f"pile-{number:02}-n{made_pile.problem.n}-{_mu_text(mu)}", made_pile.problem


def _unsolvable(seed: int) -> Iterator[Named]:
    seeds = _seeds(seed)
    for s, ratio in product(SIZES, (0.3, 1.0, 3.0)):
        yield f"s{s}-ratio{ratio:g}-unsolvable", sample(9, s, ratio, 0.4, next(seeds), solvable=False).problem


FAMILIES: dict[str, Callable[[int], Iterator[Named]]] = {
    "small": _small,
    "table": _table,
    "unsolvable": _unsolvable,
}
