"""Seconds of the transfers of a million particles, both ways, in 3D with APIC, and the bytes of a particle's state.

Each figure is the shortest of several; the peer is the same code without velocity gradients (PIC).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numba
import numpy as np

from _table import print_table


def shortest(task: Callable[[], Any], repeats: int) -> float:
    """Seconds of the quickest of several calls after one that compiles."""
    task()
    times = []
    for _ in range(repeats):
        began = perf_counter()
        task()
        times.append(perf_counter() - began)
    return min(times)


def bytes_per_particle(state: Any) -> float:
    """Bytes of the arrays of a state that have a row to a particle, and of all its arrays, both over the particles."""
    arrays = [value for value in state.arrays().values() if isinstance(value, np.ndarray)]
    return sum(value.nbytes for value in arrays) / state.particle_count


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=50, help="cells of the cube along an edge")
    parser.add_argument("--per-axis", type=int, default=2, help="particles of a cell along an edge")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    choice = parser.parse_args()
    from barchan.flows.mpm import Material, fill_box
    from barchan.flows.mpm.transfer import grid_to_particles, particles_to_grid
    from barchan.spaces import RegularGrid

    rng = np.random.default_rng(choice.seed)
    grid = RegularGrid.from_box([1.0] * 3, [choice.cells] * 3)
    lattice = fill_box(grid, [0.0] * 3, [1.0] * 3, choice.per_axis, Material(1500.0, 0.5))
    order = rng.permutation(lattice.particle_count)  # as after a long run: neighbours are far apart in memory
    state = replace(
        lattice,
        positions=np.ascontiguousarray(lattice.positions[order]),
        velocities=rng.standard_normal((lattice.particle_count, 3)),
        affine=rng.standard_normal((lattice.particle_count, 3, 3)),
    )
    rows = []
    for name, affine, given in (
        ("shuffled", True, state),
        ("shuffled", False, state),
        ("in order", True, lattice),
    ):
        matter = particles_to_grid(grid, given, affine=affine)
        back = np.ascontiguousarray(matter.velocities)
        up = shortest(lambda a=affine, s=given: particles_to_grid(grid, s, affine=a), choice.repeats)
        down = shortest(
            lambda m=matter, b=back, s=given: grid_to_particles(m, b, s.positions), choice.repeats
        )
        rows.append((name, "APIC" if affine else "PIC", given.particle_count, up, down, up + down))
    heads = ("particles", "transfer", "number", "to the grid (s)", "back (s)", "both (s)")
    print_table(f"Transfers on {numba.get_num_threads()} threads", heads, rows)
    print(f"\n{bytes_per_particle(state):.0f} bytes of state a particle")


if __name__ == "__main__":
    main()
