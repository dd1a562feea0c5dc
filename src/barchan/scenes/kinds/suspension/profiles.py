"""Means over the layers of cells: volume fraction, pore pressure, stress of the contacts (seed B, 8.4.2, Fig. 8.3).

At rest the pore pressure is that of the fluid alone, and the vertical stress of the contacts, phi lambda_zz, bears the buoyant
weight of the grains above. In a box whose sides slip that is exact with particles as quadrature points: nodes above a layer of
cells are held up by the mean of phi lambda_zz over it. Both sides are measured as the discrete model has them; nodal stresses
zigzag from layer to layer, which no balance sees. The mean normal stress phi Tr(lambda) / d, which the seed draws, differs
where friction lets horizontal stresses be others than the vertical one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.cones import chi, tensor_block_size
from barchan.flows.suspension.state import SuspensionState
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.scenes.model import Arrays
from barchan.spaces import RegularGrid, interpolate

Vector = NDArray[np.float64]


def node_layer_sums(grid: RegularGrid, values: Vector) -> Vector:
    """(m + 1,) sums of nodal `values` (n,) over the layers of nodes, upwards."""
    return np.asarray(values.reshape(-1, int(grid.nodes[-1])).sum(axis=0))


def contact_stresses(grid: RegularGrid, state: SuspensionState) -> Vector:
    """(m, 2) means over the layers of cells of phi Tr(lambda) / d and phi lambda_zz [Pa], particles as quadrature points."""
    grains, d = state.grains, grid.dimension
    if len(grains.particle_stresses):
        own = grains.particle_stresses
    else:
        nodal = np.zeros((grid.node_count, tensor_block_size(d)))
        nodal[grains.node_ids] = grains.node_stresses
        own = interpolate(grid, nodal, grains.positions)
    tensors = chi(own)
    wanted = np.stack([np.trace(tensors, axis1=1, axis2=2) / d, tensors[:, -1, -1]], axis=1)
    count = int(grid.cells[-1])
    heights = (grains.positions[:, -1] - grid.origin[-1]) / grid.spacing[-1]
    layer = np.clip(np.floor(heights).astype(np.int64), 0, count - 1)
    volume = float(np.prod(grid.upper - grid.origin)) / count
    found = [np.bincount(layer, grains.volumes * column, count) / volume for column in wanted.T]
    return np.stack(found, axis=1)


def profiles(
    parameters: SuspensionParameters, grid: RegularGrid, state: SuspensionState, fractions: Vector
) -> Arrays:
    """What a frame stores of the m layers of cells, each (m,), upwards.

    profile_z [m] of their middles, profile_fraction, profile_pressure [Pa] above that at the lid, profile_effective_stress
    phi Tr(lambda) / d, profile_vertical_stress phi lambda_zz and profile_weight, the buoyant weight of the nodes above over the
    area [Pa], compression positive. fractions : (n,) volume fractions at the nodes.
    """
    volumes = grid.node_volumes(np.arange(grid.node_count))
    room = node_layer_sums(grid, volumes)
    fraction = node_layer_sums(grid, volumes * fractions) / room
    pressure = node_layer_sums(grid, volumes * state.pressures) / room
    buoyant = (parameters.grains.density - parameters.fluid.density) * parameters.scene.gravity
    above = np.cumsum((fraction * room)[::-1])[::-1][1:] / parameters.ground
    stresses = contact_stresses(grid, state)
    edges = np.linspace(grid.origin[-1], grid.upper[-1], len(room))
    return {
        "profile_z": 0.5 * (edges[1:] + edges[:-1]),
        "profile_fraction": 0.5 * (fraction[1:] + fraction[:-1]),
        "profile_pressure": 0.5 * (pressure[1:] + pressure[:-1]) - pressure[-1],
        "profile_effective_stress": stresses[:, 0],
        "profile_vertical_stress": stresses[:, 1],
        "profile_weight": buoyant * above,
    }


def at_rest(parameters: SuspensionParameters, lines: Arrays, volume: float) -> Arrays:
    """What theory says of rest (seed B, 8.2.6), each (m,): profile_pressure of the fluid alone, profile_fraction and
    profile_vertical_stress [Pa] of grains packed on the floor. volume : of the grains [m^d]."""
    z = lines["profile_z"]
    gravity, fluid = parameters.scene.gravity, parameters.fluid.density
    densest = parameters.grains.max_volume_fraction
    bed = volume / (parameters.ground * densest)
    return {
        "profile_pressure": fluid * gravity * (parameters.height - z),
        "profile_fraction": np.where(z < bed, densest, 0.0),
        "profile_vertical_stress": (parameters.grains.density - fluid)
        * gravity
        * densest
        * np.maximum(bed - z, 0.0),
    }


def deviations(parameters: SuspensionParameters, lines: Arrays, volume: float) -> dict[str, float]:
    """Largest distances of a frame from rest: of the pore pressure from the hydrostatic one, over that at the floor; of the
    vertical contact stress from the buoyant weight above, over the whole weight."""
    exact = at_rest(parameters, lines, volume)["profile_pressure"]
    pressure = np.abs(lines["profile_pressure"] - exact).max()
    stress = np.abs(lines["profile_vertical_stress"] - lines["profile_weight"]).max()
    lighter = abs(parameters.grains.density - parameters.fluid.density) * parameters.scene.gravity
    return {
        "pressure_deviation": float(pressure / max(exact.max(), 1e-300)),
        "stress_deviation": float(stress / max(lighter * volume / parameters.ground, 1e-300)),
    }
