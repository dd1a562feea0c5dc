"""Dry grains in a plane box by the mesh-based model, as a `Model` (seed B, 7.2)."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.flows.dry import Boundary, DryFlow, DryRecord, DryState, Material, Options
from barchan.flows.dry.flow import sample_points
from barchan.results.stored_meshes import mesh_group
from barchan.scenes.kinds.dry_p0.parameters import SIDES, DryFrictionalWall, DryParameters
from barchan.scenes.model import Arrays
from barchan.spaces.meshes import tensor_rectangle

Vector = NDArray[np.float64]

FRONT = 0.5
"""The front is where the layer is thinner than this share of a cell: where the cell on the floor is less than half full."""
BULK = 0.995
MATTER = 0.01
"""Share of the packed volume fraction from which on the speed of a cell sets the time step."""


class DryModel:
    """The model of a scene of kind "dry_p0"; its states are `barchan.flows.dry.DryState`."""

    def __init__(self, parameters: DryParameters) -> None:
        self._parameters = parameters
        solver = parameters.solver
        self.mesh = build_mesh(parameters)
        self.flow = DryFlow(
            self.mesh,
            Material(**parameters.material.model_dump(), packing_tolerance=0.0),
            build_boundaries(parameters),
            gravity=parameters.scene.gravity,
            options=Options(
                solver.tolerance, solver.max_sweeps, solver.min_sweeps, solver.method, solver.inertia
            ),
        )
        self._edges = np.unique(self.mesh.p[0])
        self._columns = column_shares(self.flow, self._edges)
        self._corners = corner_incidence(self.mesh)
        self._initial_volume = float(np.sum(self.initial().fractions * self.flow.cells.volumes))

    def initial(self) -> DryState:
        """The packed rectangle at rest."""
        fill = self._parameters.fill
        first, last = fill.position, fill.position + fill.length
        return self.flow.filled(lambda x: (x[:, 0] > first) & (x[:, 0] < last) & (x[:, 1] < fill.height))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> DryState:
        """The state of a checkpoint."""
        return DryState.from_arrays(arrays)

    def arrays(self, state: DryState) -> Arrays:
        """The complete state, for a checkpoint."""
        return state.arrays()

    def longest_step(self, state: DryState) -> float:
        """The step of the scene, or less so that the fastest matter crosses at most `cfl` of the shortest edge of a cell."""
        time = self._parameters.time
        speed = self.flow.max_speed(state, MATTER)
        return time.step if speed == 0.0 else min(time.step, time.cfl * min(self._parameters.spacing) / speed)

    def advance(self, state: DryState, dt: float) -> tuple[DryState, DryRecord]:
        """One time step."""
        return self.flow.advance(state, dt)

    def ended(self, state: DryState) -> bool:
        """Whether so much matter has left that the scene is over."""
        least = self._parameters.time.least_volume
        return float(np.sum(state.fractions * self.flow.cells.volumes)) <= least * self._initial_volume

    def frame(self, state: DryState) -> dict[str, Arrays]:
        """Fields at the vertices and the profile of the surface; the mesh with the first frame."""
        groups: dict[str, Arrays] = {"mesh": mesh_group(self.mesh)} if state.step == 0 else {}
        return {**groups, "fields": self._fields(state), "lines": self.profile(state)}

    def observables(self, state: DryState, record: DryRecord | None) -> dict[str, float]:
        """Scalars of a frame."""
        cells, fill = self.flow.cells, self._parameters.fill
        matter = state.fractions * cells.volumes
        volume, density = float(np.sum(matter)), self.flow.material.density
        kinetic = 0.0 if record is None else record.kinetic_energy
        weight = density * self._parameters.scene.gravity
        return {
            "time": state.time,
            "volume": volume,
            "left": state.left,
            "volume_drift": (volume + state.left) / self._initial_volume - 1.0,
            **self._geometry(state),
            "kinetic_energy": kinetic,
            "potential_energy": weight * float(matter @ cells.centres[:, 1]),
            "max_speed": self.flow.max_speed(state),
            "min_volume_fraction": float(np.min(state.fractions)),
            "max_volume_fraction": float(np.max(state.fractions)),
            "aspect_ratio": fill.height / fill.length,
        }

    def profile(self, state: DryState) -> Arrays:
        """surface_x (m,) middles of the columns of cells and surface_height (m,), the matter in each packed on the floor."""
        widths = np.diff(self._edges)
        packed = self._parameters.material.max_volume_fraction
        height = (self._columns @ (state.fractions * self.flow.cells.volumes)) / (widths * packed)
        return {"surface_x": self._edges[:-1] + 0.5 * widths, "surface_height": height}

    def _geometry(self, state: DryState) -> dict[str, float]:
        """Front, run-out and heights; the front is found by interpolation between middles of columns."""
        fill, profile = self._parameters.fill, self.profile(state)
        x, height = profile["surface_x"], profile["surface_height"]
        front = front_of(x, height, FRONT * self._parameters.spacing[1], float(self._edges[-1]))
        behind = np.concatenate([[0.0], np.cumsum(height * np.diff(self._edges))])
        bulk = float(np.interp(BULK * behind[-1], behind, self._edges)) if behind[-1] > 0.0 else 0.0
        start = fill.position + fill.length
        return {
            "front": front,
            "front_bulk": bulk,
            "run_out": (front - start) / fill.length,
            "run_out_bulk": (bulk - start) / fill.length,
            "height": float(np.max(height)),
            "height_ratio": float(np.max(height)) / fill.height,
        }

    def _fields(self, state: DryState) -> Arrays:
        """Means over the cells around each vertex, velocities by matter, the rest by volume."""
        volumes = self.flow.cells.volumes
        matter = state.fractions * volumes
        around, mass = self._corners @ volumes, self._corners @ matter

        def mean(values: Vector) -> Vector:
            return np.asarray(self._corners @ (volumes * values) / around)

        momentum = self._corners @ (matter[:, None] * state.velocities)
        return {
            "velocities": momentum / np.maximum(mass, 1e-300)[:, None],
            "volume_fractions": mean(state.fractions),
            "pressures": mean(state.stresses[:, 0]),  # in the plane Tr/2 is the component N
            "shear_stresses": mean(np.linalg.norm(state.stresses[:, 1:], axis=1)),
        }


def build_mesh(parameters: DryParameters) -> Any:
    """The box, with vertices at the edges of the outlet, whose sides are the part "outlet"."""
    (length, height), (along, up) = parameters.mesh.size, parameters.mesh.cells
    outlet = parameters.outlet
    stops = [0.0, outlet.position, outlet.position + outlet.width, length] if outlet.width else [0.0, length]
    pieces = []
    for start, end in pairwise(stops):
        if end - start > 1e-9 * length:
            pieces.append(np.linspace(start, end, max(1, round((end - start) * along / length)) + 1)[:-1])
    x = np.append(np.concatenate(pieces), length)
    mesh = tensor_rectangle(x, np.linspace(0.0, height, up + 1), parameters.mesh.shape)
    if not outlet.width:
        return mesh
    floor = mesh.boundaries["bottom"]
    middles = np.mean(mesh.p[0][mesh.facets[:, floor]], axis=0)
    opened = (middles > outlet.position) & (middles < outlet.position + outlet.width)
    parts = {name: facets for name, facets in mesh.boundaries.items() if name != "bottom"}
    parts["outlet"] = floor[opened]
    if not np.all(opened):
        parts["bottom"] = floor[~opened]
    return type(mesh)(mesh.p, mesh.t, _boundaries=parts)


def build_boundaries(parameters: DryParameters) -> dict[str, Boundary]:
    """What the parts of the mesh do."""
    found = {"outlet": Boundary("free")} if parameters.outlet.width else {}
    for key, part in SIDES.items():
        choice = getattr(parameters.walls, key)
        frictional = isinstance(choice, DryFrictionalWall)
        found[part] = Boundary("friction", choice.friction) if frictional else Boundary(choice)
    if parameters.outlet.width >= parameters.mesh.size[0] * (1.0 - 1e-9):
        del found["bottom"]
    return found


def column_shares(flow: DryFlow, edges: Vector) -> sp.csr_array:
    """(m, c) shares of each cell in the m columns between the abscissae `edges`."""
    points, weights = sample_points(flow.cells)
    place = np.clip(np.searchsorted(edges, points[..., 0], side="right") - 1, 0, len(edges) - 2)
    cell = np.broadcast_to(np.arange(flow.cells.count)[:, None], place.shape)
    shape = (len(edges) - 1, flow.cells.count)
    return sp.coo_array((weights.ravel(), (place.ravel(), cell.ravel())), shape=shape).tocsr()


def corner_incidence(mesh: Any) -> sp.csr_array:
    """(V, c) ones where a vertex is a corner of a cell."""
    corners = mesh.t
    cell = np.broadcast_to(np.arange(corners.shape[1]), corners.shape)
    ones = np.ones(corners.size)
    return sp.csr_array((ones, (corners.ravel(), cell.ravel())), shape=(mesh.p.shape[1], corners.shape[1]))


def front_of(x: Vector, height: Vector, least: float, end: float) -> float:
    """Farthest abscissa where a layer of heights (m,) at x (m,) is `least` thick; 0 where it is nowhere, else at most `end`."""
    thick = np.flatnonzero(height >= least)
    if len(thick) == 0:
        return 0.0
    last = int(thick[-1])
    if last + 1 == len(x):
        return end
    share = (height[last] - least) / (height[last] - height[last + 1])
    return float(x[last] + share * (x[last + 1] - x[last]))
