"""The nodal algorithm against the dual route on a sheet that turns with a ball (seed B, Table 4.4): seconds of processor time.

A square cloth lies on a ball and hangs from it; the ball turns. A few steps are made, then the problem of the next one is
solved by every route from zero forces: dual (factor, dense W, exact sweeps), nodal in three variants. Ratios are of build
plus solve.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from _table import print_table
from barchan.bench.nodal import time_dual, time_nodal
from barchan.bodies.cloth import Cloth, ClothAssembly, ClothMaterial, ClothOptions, rectangle
from barchan.bodies.rigid import Body, Prescribed, Sphere
from barchan.friction import Problem
from barchan.friction.methods.nodal.method import VARIANTS

RADIUS, LEAVES = 0.24, math.radians(33.0)  # m; latitude from which the cloth leaves the ball


def draped(flat: np.ndarray) -> np.ndarray:
    """Points (n, 3) of a flat sheet laid on the ball along its meridians, and straight on from where it leaves the ball."""
    distance = np.hypot(flat[:, 0], flat[:, 1])
    angle = np.minimum(distance / RADIUS, LEAVES)
    beyond = np.maximum(distance - LEAVES * RADIUS, 0.0)
    radius = RADIUS * np.sin(angle) + math.cos(LEAVES) * beyond
    fold = np.divide(radius, distance, out=np.ones_like(distance), where=distance > 0.0)
    height = RADIUS * np.cos(angle) - math.sin(LEAVES) * beyond
    return np.column_stack([fold[:, None] * flat[:, :2], height])


def turning_sheet(across: int, side: float, dt: float, young: float, steps: int, friction: float) -> Problem:
    """The friction problem after `steps` steps of a sheet of about across^2 vertices on a ball that starts to turn."""
    mesh = rectangle(side, side, side / (across - 1), "crossed")
    material = ClothMaterial(young_modulus=young, thickness=1e-3, area_density=0.2, friction=friction)
    start = draped(mesh.vertices) * (1.0 + 0.5 * material.thickness / RADIUS)
    turn = Prescribed(
        [0.0, 1.0], np.zeros((2, 3)), [(1.0, 0.0, 0.0, 0.0), (np.cos(1.0), 0.0, 0.0, np.sin(1.0))]
    )
    ball = Body(Sphere(RADIUS), motion=turn, friction=friction)
    cloth = Cloth(mesh, material, start=start)
    assembly = ClothAssembly(
        cloth, [ball], options=ClothOptions(tolerance=1e-4, method="nodal", recovery=0.2)
    )
    state = assembly.started()
    for _ in range(steps):
        state, _ = assembly.advance(state, dt)
    return assembly.problem(state, dt)


def main() -> None:
    """Print a table for each time step and tolerance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--across", type=int, nargs="*", default=[73], help="vertices along a side")
    parser.add_argument("--side", type=float, default=0.7, help="m")
    parser.add_argument("--steps", type=float, nargs="*", default=[0.002, 0.005], help="time steps, s")
    parser.add_argument("--young", type=float, default=1e5, help="Pa")
    parser.add_argument("--before", type=int, default=3, help="steps made before the one that is timed")
    parser.add_argument("--friction", type=float, default=0.3)
    parser.add_argument("--tolerances", type=float, nargs="*", default=[1e-4, 1e-6])
    parser.add_argument("--repeats", type=int, default=3, help="of the nodal routes, the least is taken")
    choice = parser.parse_args()
    warm = turning_sheet(12, choice.side, 0.005, choice.young, 1, choice.friction)
    for variant in VARIANTS:
        time_nodal(warm, 1e-6, variant)
    time_dual(warm, 1e-6)
    heads = (
        "vertices",
        "contacts",
        "dt, ms",
        "tolerance",
        "route",
        "build",
        "solve",
        "passes",
        "certificate",
        "ratio",
    )
    rows: list[tuple[object, ...]] = []
    for across in choice.across:
        for dt in choice.steps:
            problem = turning_sheet(across, choice.side, dt, choice.young, choice.before, choice.friction)
            for tolerance in choice.tolerances:
                dual = time_dual(problem, tolerance)
                nodal = [
                    min(
                        (time_nodal(problem, tolerance, variant) for _ in range(choice.repeats)),
                        key=lambda t: t.total,
                    )
                    for variant in VARIANTS
                ]
                for timing in (dual, *nodal):
                    head = (problem.size // 3, problem.n, 1e3 * dt, tolerance)
                    rows.append((*head, *timing, None if timing is dual else dual.total / timing.total))
    print_table("Dual and nodal, seconds of processor time", heads, rows)


if __name__ == "__main__":
    main()
