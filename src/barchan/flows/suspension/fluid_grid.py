"""The fluid on the nodes of the box: weak divergence, viscous stiffness, nodal volumes (seed B, 8.3.2 and 8.3.4).

Velocities are multilinear on all nodes. Three spaces of pressures, all products of functions of one coordinate, hence
integrated exactly:
  "layers"     linear on cells twice as wide in the horizontal, constant on each layer of cells in the vertical. Stable (inf-sup
               constant 0.25 in a square, against 0.17 of "coarse"); a fluid whose density depends on the height alone rests
               exactly, since no u_z(z) but zero is free of divergence.
  "coarse"     multilinear on cells twice as wide along every axis (Bercovier and Pironneau's pair). Stable, but it has less
               than one pressure a layer: u_z(z) of the period of these cells has no weak divergence, and a jump of the density
               drives it (the hydrostatic test of a density step shows this). For fluids of one density.
  "penalised"  multilinear on the grid itself, with div u = -penalty p: seed B's choice; not stable without the penalty.
Nothing here depends on the time step or on the grains, so it is assembled once a run.
"""

from __future__ import annotations

from functools import reduce
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.suspension import _fluid_kernels as kernels
from barchan.flows.suspension.phases import FREE
from barchan.flows.suspension.sides import Sides
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]
PRESSURES = ("layers", "coarse", "penalised")


class FluidGrid:
    """Matrices of an incompressible fluid on the n nodes of a grid.

    Parameters
    ----------
    grid, sides : the box and its faces.
    pressure : "layers", "coarse" or "penalised", see above.
    penalty : of "penalised", the compressibility in div u = -penalty p [1/(Pa s)], > 0 (`penalty_for` proposes one).

    Attributes
    ----------
    divergence : (c, n d) csr, (B u)_q = integral of psi_q div u [m^d/s]; B^T p are the forces [N] of pressures p [Pa].
        In a closed box the rows of the unpenalised spaces add up to zero on admissible velocities: one is left out.
    kept : (c,) which pressures have a row.   closed : whether no face is open.
    volumes : (n,) nodal volumes [m^d].   pressure_volumes : (c,) integrals of psi_q [m^d].
    slack_masses : (c,) 1 / (penalty V_q), masses [Pa s / m^d] of slack velocities s in B u + s = k; None without penalty.

    Raises
    ------
    InputError : unknown space, odd numbers of cells where cells are paired, a penalty that is not positive (or is missing, or
        given to another space), net flux into a closed box, velocity components too few for the pressures.
    """

    def __init__(
        self, grid: RegularGrid, sides: Sides, pressure: str = "layers", penalty: float | None = None
    ) -> None:
        if pressure not in PRESSURES:
            raise InputError("pressure", pressure, "one of " + ", ".join(PRESSURES))
        if (penalty is not None) != (pressure == "penalised"):
            raise InputError("penalty", penalty, "given for penalised pressures, and only for these")
        if penalty is not None and not (np.isfinite(penalty) and penalty > 0.0):
            raise InputError("penalty", penalty, "a finite number > 0 (1/Pa/s)")
        sides.check_fluxes(grid)
        self.grid, self.sides, self.pressure, self.penalty = grid, sides, pressure, penalty
        self.closed = sides.closed(grid.dimension)
        self._axes = [_axis_of(grid, axis, pressure) for axis in range(grid.dimension)]
        total = int(np.prod([a.values.shape[0] for a in self._axes]))
        drop = self.closed and pressure != "penalised"
        self.kept: NDArray[np.int64] = np.arange(total - 1 if drop else total)
        self.divergence = _divergence(self._axes)[self.kept]
        self.volumes = grid.node_volumes(np.arange(grid.node_count))
        self.pressure_volumes: Vector = reduce(np.kron, [a.values.sum(axis=1) for a in self._axes])[self.kept]
        self.slack_masses = None if penalty is None else 1.0 / (penalty * self.pressure_volumes)
        self._nodal = reduce(_kron, [a.at_nodes for a in self._axes])
        self._element = _element_stiffness(grid)
        self._pattern = _neighbours(grid)
        free = sides.boundary(grid)[0] == FREE
        if self.slack_masses is None and np.count_nonzero(free) < len(self.kept):
            raise InputError(
                "grid.cells", grid.cells.tolist(), "more: there are fewer velocities than pressures"
            )

    def pressure_field(self, p: Vector) -> Vector:
        """(n,) pressures [Pa] at the nodes for the multipliers p (c,); of zero mean over a closed box unless penalised.

        Linear pressures are reproduced: layers are averaged at their common nodes and continued linearly to floor and lid.
        """
        whole = np.zeros(self._nodal.shape[1])
        whole[self.kept] = p
        field: Vector = self._nodal @ whole
        if self.closed and self.pressure != "penalised":
            field -= self.volumes @ field / self.volumes.sum()
        return field

    def stiffness(self, viscosity: Vector | float) -> sp.bsr_array:
        """K (n d, n d) in blocks (d, d): v.K u = integral of 2 eta D(u):D(v) [kg/s], eta [Pa s] constant in each cell.

        viscosity : one number, or (n,) at the nodes (a cell takes the mean of its corners), or (cells,).
        Raises InputError for another size or values that are negative or not finite.
        """
        d, (indptr, indices) = self.grid.dimension, self._pattern
        blocks = np.empty((len(indices), d, d))
        nodes = _in_space(self.grid.nodes)
        kernels.assemble_stiffness(nodes, self._of_cells(viscosity), self._element, indptr, blocks)
        return sp.bsr_array((blocks, indices, indptr), shape=(len(self.volumes) * d, len(self.volumes) * d))

    def largest_divergence(self, velocities: Vector) -> float:
        """max_q |(B u)_q| / V_q [1/s] of u (n, d): mean divergences over the supports of the pressures."""
        weak = self.divergence @ np.asarray(velocities, dtype=float).reshape(-1)
        return float(np.max(np.abs(weak) / self.pressure_volumes))

    def _of_cells(self, viscosity: Vector | float) -> Vector:
        eta = np.asarray(viscosity, dtype=float)
        cells, nodes = self.grid.cell_count, self.grid.node_count
        if eta.ndim == 0:
            eta = np.full(cells, float(eta))
        if eta.shape not in ((cells,), (nodes,)):
            raise InputError("viscosity", eta.shape, f"one number, {nodes} (nodes) or {cells} (cells)")
        if not np.all(np.isfinite(eta)) or np.any(eta < 0.0):
            raise InputError("viscosity", eta, "finite and >= 0 (Pa s)")
        if len(eta) == cells:
            return np.ascontiguousarray(eta)
        field = eta.reshape(tuple(self.grid.nodes))
        for axis in range(self.grid.dimension):
            lower, upper = np.split(np.arange(field.shape[axis]), [1])
            field = 0.5 * (np.delete(field, lower, axis) + np.take(field, np.append(lower, upper[:-1]), axis))
        return np.ascontiguousarray(field.reshape(-1))


def penalty_for(density: float, gravity: float, height: float, share: float = 1e-3) -> float:
    """Penalty [1/(Pa s)] with which the hydrostatic pressure rho g H compresses at `share` of the rate sqrt(g / H)."""
    for name, value in (("density", density), ("gravity", gravity), ("height", height), ("share", share)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(name, value, "a finite number > 0")
    return share * float(np.sqrt(gravity / height)) / (density * gravity * height)


class _Axis:
    """Pressures psi_J and velocities N_i along one axis.

    values (j, i) integrals of psi_J N_i; slopes (j, i) of psi_J dN_i/dx; at_nodes (i, j) nodal values of the pressures.
    """

    def __init__(self, values: Any, slopes: Any, at_nodes: Any) -> None:
        self.values, self.slopes, self.at_nodes = map(sp.csr_array, (values, slopes, at_nodes))


def _axis_of(grid: RegularGrid, axis: int, pressure: str) -> _Axis:
    count, h = int(grid.cells[axis]), float(grid.spacing[axis])
    if pressure == "layers" and axis == grid.dimension - 1:
        return _layers(count, h)
    lumps = np.full(count + 1, 2.0 / 3.0)
    lumps[[0, -1]] = 1.0 / 3.0
    sixth = np.full(count, 1.0 / 6.0)
    values = h * sp.diags_array([sixth, lumps, sixth], offsets=[-1, 0, 1])
    ends = np.zeros(count + 1)
    ends[[0, -1]] = -0.5, 0.5
    half = np.full(count, 0.5)
    slopes = sp.diags_array([-half, ends, half], offsets=[-1, 0, 1])
    if pressure == "penalised":
        return _Axis(values, slopes, sp.eye_array(count + 1))
    if count % 2:
        raise InputError(
            "grid.cells", grid.cells.tolist(), f"even along axis {axis} with {pressure} pressures"
        )
    pairs = np.arange(count // 2)
    coarse = sp.lil_array((count + 1, count // 2 + 1))
    coarse[2 * np.append(pairs, count // 2), np.append(pairs, count // 2)] = 1.0
    coarse[2 * pairs + 1, pairs] = 0.5
    coarse[2 * pairs + 1, pairs + 1] = 0.5
    prolonged = sp.csr_array(coarse)
    return _Axis(prolonged.T @ values, prolonged.T @ slopes, prolonged)


def _layers(count: int, h: float) -> _Axis:
    one = np.ones(count)
    values = sp.diags_array([0.5 * h * one, 0.5 * h * one], offsets=[0, 1], shape=(count, count + 1))
    slopes = sp.diags_array([-one, one], offsets=[0, 1], shape=(count, count + 1))
    nodal = sp.lil_array(sp.diags_array([0.5 * one, 0.5 * one], offsets=[-1, 0], shape=(count + 1, count)))
    for end, first, second in ((0, 0, 1), (count, count - 1, count - 2)):
        if count == 1:
            nodal[end, 0] = 1.0
        else:
            nodal[end, first], nodal[end, second] = 1.5, -0.5
    return _Axis(values, slopes, nodal)


def _kron(a: sp.csr_array, b: sp.csr_array) -> sp.csr_array:
    # Without a format SciPy stores the zeros of small dense factors.
    return sp.csr_array(sp.kron(a, b, format="csr"))


def _divergence(axes: list[_Axis]) -> sp.csr_array:
    """(c, n d): column n d + k holds the integrals of psi_q dN_n/dx_k."""
    d, pieces = len(axes), []
    for k in range(d):
        factors = [a.slopes if axis == k else a.values for axis, a in enumerate(axes)]
        found = sp.coo_array(reduce(_kron, factors))
        row, node = found.coords
        pieces.append((row, node * d + k, found.data))
    rows, columns, data = (np.concatenate(part) for part in zip(*pieces, strict=True))
    kept = data != 0.0
    shape = (found.shape[0], found.shape[1] * d)
    return sp.csr_array((data[kept], (rows[kept], columns[kept])), shape=shape)


def _in_space(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3,) with 1 for the axis that a plane grid lacks."""
    return np.append(counts, np.ones(3 - len(counts), dtype=np.int64))


def _corners(dimension: int) -> list[tuple[int, ...]]:
    return list(product((0, 1), repeat=dimension))


def _element_stiffness(grid: RegularGrid) -> Vector:
    """(2^d, 2^d, d, d) blocks of a cell of unit viscosity, by the Gauss rule of two points an axis, which is exact."""
    d, corners = grid.dimension, np.array(_corners(grid.dimension))
    points = 0.5 + (corners - 0.5) / np.sqrt(3.0)
    factors = np.where(corners[None] == 1, points[:, None], 1.0 - points[:, None])  # point, corner, axis
    gradients = np.empty((len(points), len(corners), d))
    for k in range(d):
        slope = np.where(corners[:, k] == 1, 1.0, -1.0) / grid.spacing[k]
        gradients[..., k] = slope * np.prod(np.delete(factors, k, axis=-1), axis=-1)
    weight = grid.cell_volume / len(points)
    # 2 D(N_a e_k):D(N_b e_l) = delta_kl grad N_a . grad N_b + d_l N_a d_k N_b
    blocks = weight * np.einsum("pal,pbk->abkl", gradients, gradients)
    diagonal = weight * np.einsum("pak,pbk->ab", gradients, gradients)
    blocks += diagonal[:, :, None, None] * np.eye(d)
    return np.ascontiguousarray(blocks)


def _neighbours(grid: RegularGrid) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """indptr, indices of the nodes that share a cell with each node, in increasing order."""
    bands = [
        sp.diags_array([np.ones(n - 1), np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1]) for n in grid.nodes
    ]
    graph = reduce(_kron, [sp.csr_array(band) for band in bands])
    graph.sort_indices()
    return graph.indptr.astype(np.int32), graph.indices.astype(np.int32)
