"""Table 4.3 of seed B on made problems (`samples.family("table")`: 120 of 10 to 200 contacts); see `bench.local_solvers`."""

from __future__ import annotations

import argparse

import numba

from _table import print_table
from barchan.bench.local_solvers import HEADS, compare
from barchan.friction import samples


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--family", default="table", help="a family of barchan.friction.samples with s = 3")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sweeps", type=int, default=2000, help="limit on the sweeps of a problem")
    parser.add_argument("--repeats", type=int, default=3)
    choice = parser.parse_args()
    numba.set_num_threads(1)
    named = samples.family(choice.family, choice.seed)
    problems = [problem for _, problem in named if problem.s == 3]
    table = compare(problems, sweeps=choice.sweeps, repeats=choice.repeats)
    title = (
        f"{len(problems)} problems, tolerance {table.tolerance:g}, at most {table.sweeps} sweeps, one thread; the pyramid "
        f"alone stops at steps of {table.typical:.1e}"
    )
    print_table(title, HEADS, table.lines())


if __name__ == "__main__":
    main()
