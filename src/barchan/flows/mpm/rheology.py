"""What the stresses of a step may be: friction, cohesion, yield, dilatancy, anisotropy at the rows (seed B, 7.1 and 7.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import normalised_friction
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.orientation import friction_metric, inverse_metric_blocks, metric_blocks
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stresses import StressRows

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rheology:
    """The law of each row, in physical coefficients.

    friction, dilatancy : (q,).  shear_yield, tensile_yield : (q,) [Pa]; tension as a pressure.
    metric, inverse_metric : (q, s, s) of anisotropic friction, None when it is isotropic.
    """

    friction: Vector
    dilatancy: Vector
    shear_yield: Vector
    tensile_yield: Vector
    metric: Vector | None
    inverse_metric: Vector | None

    def law_parameters(self, d: int) -> tuple[Vector, Vector, Vector, Vector]:
        """(mu, shear_yield, tensile_yield, dilatancy) in cone coordinates: N = sqrt(d/2) p (ERRATA 1)."""
        return (
            np.asarray(normalised_friction(self.friction, d)),
            self.shear_yield,
            np.sqrt(d / 2.0) * self.tensile_yield,
            np.asarray(normalised_friction(self.dilatancy, d)),
        )


def rheology(
    rows: StressRows,
    strain: sp.bsr_array,
    velocities: Vector,
    state: State,
    materials: Sequence[Material],
    stresses: Vector,
    packed: NDArray[np.bool_],
) -> Rheology:
    """The law of each row at the start of a step.

    mu(I) is explicit: strain rate of `velocities` (n, d), pressure of `stresses` (q, s) [Pa]. Cohesion and the yield stresses
    hold where matter is `packed` (q,) only (seed B, Remark 7.1). Rows that several materials share have the means of their
    coefficients, weighted by volume.
    """
    d = velocities.shape[1]
    shares = _shares(rows, state, len(materials))
    shear_rate, pressure = np.zeros(len(rows.ids)), np.sqrt(2.0 / d) * stresses[:, 0]
    if any(material.rate_dependent for material in materials):
        rates = (strain @ velocities.reshape(-1)).reshape(len(rows.ids), -1) / (2.0 * rows.volumes[:, None])
        shear_rate = np.sqrt(np.sum(rates[:, 1:] ** 2, axis=1))
    friction = _mixed(
        shares, [np.broadcast_to(m.friction_at(shear_rate, pressure), shear_rate.shape) for m in materials]
    )
    bound = np.ones(len(rows.ids))
    if len(state.cohesions):
        bound = rows.averages(state.volumes, state.cohesions[:, None])[:, 0]
    ones = np.ones(len(rows.ids))
    cohesion = bound * _mixed(shares, [m.cohesion * ones for m in materials])
    tensile = cohesion + _mixed(shares, [m.tensile_yield * ones for m in materials])
    shear = _mixed(shares, [m.shear_yield * ones for m in materials])
    dilatancy = np.minimum(_mixed(shares, [m.dilatancy * ones for m in materials]), friction)
    metric, inverse = None, None
    anisotropy = max(material.anisotropy for material in materials)
    if anisotropy > 0.0:
        tensors = rows.averages(
            state.volumes, state.orientations.reshape(len(state.orientations), -1)
        ).reshape(-1, d, d)
        metric = metric_blocks(friction_metric(tensors, anisotropy))
        inverse = inverse_metric_blocks(friction_metric(tensors, anisotropy))
    return Rheology(
        friction, dilatancy, np.where(packed, shear, 0.0), np.where(packed, tensile, 0.0), metric, inverse
    )


def _shares(rows: StressRows, state: State, count: int) -> Vector | None:
    if count == 1:
        return None
    belongs = (state.materials[:, None] == np.arange(count)).astype(np.float64)
    return rows.averages(state.volumes, belongs)


def _mixed(shares: Vector | None, values: list[Vector]) -> Vector:
    if shares is None:
        return np.array(values[0], dtype=np.float64)
    return np.asarray(np.sum(shares * np.stack(values, axis=1), axis=1))
