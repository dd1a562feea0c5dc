"""What is measured of a scene of kind "sand" at each frame, and the figures of the finished run (seed B 7.5).

Energies, momenta and the poses of bodies always; run-out, volume above a plate and outline from above where [observe] asks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, BodyStates, kinetic_energy
from barchan.bodies.rigid.dynamics import centre_of
from barchan.flows.mpm import State
from barchan.results.heaps import HeightMap, height_map, outline_of
from barchan.scenes.granular.discharge import discharge_figures
from barchan.scenes.granular.figures import (
    ColumnReference,
    energy_figures,
    rest_figures,
    run_out_observables,
    solver_figures,
)
from barchan.scenes.granular.surface import free_surface
from barchan.scenes.kinds.sand.options import remarks
from barchan.scenes.kinds.sand.parameters import SandParameters

Vector = NDArray[np.float64]

AXES = {2: "xz", 3: "xyz"}
_SPINS = {2: ("spin",), 3: ("spin_x", "spin_y", "spin_z")}
_TURNS = {2: ("angle",), 3: ("qw", "qx", "qy", "qz")}


def densities_of(parameters: SandParameters, state: State) -> Vector:
    """(P,) density of the material of each particle (kg/m^3)."""
    found = np.array([material.density for material in parameters.all_materials().values()])
    if len(state.materials) == 0:
        return np.full(state.particle_count, found[0])
    return np.asarray(found[state.materials])


def matter_observables(parameters: SandParameters, state: State) -> dict[str, float]:
    """Volume, energies, momenta and extent of the matter."""
    masses = densities_of(parameters, state) * state.volumes
    momentum = masses @ state.velocities
    gravity = np.array(parameters.gravity_vector)
    speeds = np.sqrt(np.sum(state.velocities**2, axis=1))
    return {
        "particles": float(state.particle_count),
        "volume": float(np.sum(state.volumes)),
        "kinetic_energy": 0.5 * float(np.sum(masses * speeds**2)),
        "potential_energy": -float(masses @ (state.positions @ gravity)),
        "max_speed": float(speeds.max()),
        "top": float(state.positions[:, -1].max()),
        "front": float(state.positions[:, 0].max()) - parameters.observe.back,
        **{f"momentum_{axis}": float(p) for axis, p in zip(AXES[state.dimension], momentum, strict=True)},
    }


def body_observables(
    parameters: SandParameters, bodies: Sequence[Body], states: BodyStates, matter: Mapping[str, float]
) -> dict[str, float]:
    """Pose and velocity of each body, energies of all, and the momentum of free bodies and matter together."""
    d = parameters.dimension
    gravity = np.array(parameters.gravity_vector)
    values: dict[str, float] = {}
    kinetic, potential, momentum = 0.0, 0.0, np.zeros(d)
    for number, body in enumerate(bodies):
        row = states.row(number)
        named = {
            **dict(zip(AXES[d], row.position, strict=True)),
            **dict(zip((f"v{axis}" for axis in AXES[d]), row.velocity, strict=True)),
            **dict(zip(_TURNS[d], row.rotation, strict=True)),
            **dict(zip(_SPINS[d], row.spin, strict=True)),
        }
        values |= {f"{body.name}_{name}": float(value) for name, value in named.items()}
        if not body.driven:
            kinetic += kinetic_energy(body, row)
            potential -= body.mass * float(gravity @ centre_of(body, row))
            momentum += body.mass * row.velocity
    if bodies:
        values |= {"bodies_kinetic_energy": kinetic, "bodies_potential_energy": potential}
        for axis, p in zip(AXES[d], momentum, strict=True):
            values[f"total_momentum_{axis}"] = float(p) + matter[f"momentum_{axis}"]
    return values


def observed(parameters: SandParameters, positions: Vector, volumes: Vector) -> dict[str, float]:
    """What [observe] asks for, of particles at `positions` (P, d) m with `volumes` (P,) m^d."""
    observe = parameters.observe
    values: dict[str, float] = {}
    if observe.length is not None and observe.height is not None:
        column = ColumnReference(observe.length, observe.height, observe.back)
        surface = free_surface(
            positions, volumes, parameters.box.size, parameters.box.cells, packed(parameters)
        )
        values |= run_out_observables(column, surface, positions, volumes, parameters.spacing[-1])
    if observe.level is not None:
        values["volume_above"] = float(np.sum(volumes[positions[:, -1] > observe.level]))
    if observe.outline != "none":
        values |= outline_observables(parameters, heights_of(parameters, positions, volumes))
    return values


def outline_observables(parameters: SandParameters, heights: HeightMap) -> dict[str, float]:
    """Mean radius and circularity of the outline of a heap or crater, and the height of the surface inside."""
    observe = parameters.observe
    assert observe.outline != "none"
    outline = outline_of(heights, outline_centre(parameters), outline_level(parameters), observe.outline)
    return {
        "outline_radius": outline.mean_radius,
        "outline_circularity": outline.circularity,
        "outline_fourfold": outline.harmonic(4),
        "surface_lowest": float(heights.height.min()),
        "surface_highest": float(heights.height.max()),
    }


def packed(parameters: SandParameters) -> float:
    """The volume fraction that heights are computed with: that of [material]."""
    return parameters.material.max_volume_fraction


def heights_of(parameters: SandParameters, positions: Vector, volumes: Vector) -> HeightMap:
    """The matter seen from above, over two or three cells: heights of single nodes carry the noise of single particles."""
    size, cells = parameters.box.size, parameters.box.cells
    return height_map(positions, volumes, size, cells, packed(parameters)).smoothed()


def outline_level(parameters: SandParameters) -> float:
    """Height (m) at which the outline is taken."""
    given = parameters.observe.outline_height
    return max(parameters.spacing[:2]) if given is None else given


def outline_centre(parameters: SandParameters) -> tuple[float, float]:
    """Centre (m) of the outline."""
    x, y = parameters.observe.centre or [0.5 * length for length in parameters.box.size[:2]]
    return x, y


def pose_of(
    observables: Mapping[str, Vector], name: str, frame: int, dimension: int
) -> tuple[Vector, Vector]:
    """Position (d,) m and rotation (4,) or (1,) of the body `name` at a frame of a stored run."""
    position = np.array([observables[f"{name}_{axis}"][frame] for axis in AXES[dimension]])
    rotation = np.array([observables[f"{name}_{turn}"][frame] for turn in _TURNS[dimension]])
    return position, rotation


def summarise(
    parameters: SandParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures of a finished run for summary.json, from its step records (steps,) and observables (frames,)."""
    skipped = ("time", "kinetic_energy", "potential_energy")
    final = {name: float(values[-1]) for name, values in observables.items() if name not in skipped}
    drop = max(float(observables["top"][0]), parameters.spacing[-1])
    figures: dict[str, Any] = {
        "end_time": float(observables["time"][-1]),
        **final,
        **rest_figures(steps, math.sqrt(max(parameters.scene.gravity, 1e-12) * drop)),
        "volume_left": float(observables["volume"][-1] / observables["volume"][0]),
        "largest_volume_fraction": float(steps["max_volume_fraction"].max()),
        "most_particles": int(observables["particles"].max()),
        "most_active_nodes": int(steps["active_nodes"].max()),
        **solver_figures(steps, parameters.solver.tolerance),
        "remarks": remarks(parameters),
    }
    if not list(parameters.body_tables()):
        figures |= energy_figures(steps, observables)
    if parameters.observe.level is not None:
        figures |= discharge_figures(observables["time"], observables["volume_above"])
    if parameters.scene.gravity == 0.0:
        figures["momentum_drift"] = momentum_drift(observables, parameters.dimension)
    return figures


def momentum_drift(observables: Mapping[str, Vector], dimension: int) -> float:
    """Largest change of the momentum of matter and free bodies, relative to the largest momentum of the matter alone."""
    prefix = "total_momentum" if f"total_momentum_{AXES[dimension][0]}" in observables else "momentum"
    total = np.stack([observables[f"{prefix}_{axis}"] for axis in AXES[dimension]])
    alone = np.stack([observables[f"momentum_{axis}"] for axis in AXES[dimension]])
    scale = max(float(np.linalg.norm(alone, axis=0).max()), float(np.linalg.norm(total[:, 0])), 1e-300)
    return float(np.linalg.norm(total - total[:, :1], axis=0).max() / scale)
