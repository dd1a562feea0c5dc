"""Generalised Navier-Stokes equations with a viscosity eta(|D(u)|, p) on a mesh with curved cells (seed C 4.1.6).

rho (du/dt + (u . grad) u) - div(2 eta D(u)) + grad p = f, div u = 0; the weak form has the symmetric gradient. The residual is
that of the true equations whatever the solver; `jacobian` gives the matrices of all its Newton variants (seed C 4.1.8).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.flows.conditions import Pressure, Stress
from barchan.flows.quasi_newtonian._kernels import element_matrices, momentum_vectors, sample
from barchan.flows.quasi_newtonian.conditions import ChannelEnd, Condition, Slip, prescribed_pressure
from barchan.flows.quasi_newtonian.constraints import Constraints, check_parts, constrain, open_parts
from barchan.flows.quasi_newtonian.models import ViscosityModel
from barchan.spaces.mixed import sampled
from barchan.spaces.quadratic import QuadraticSpace

NET_FLUX = 1e-6
ROUNDING = 4e-16


@dataclass(frozen=True, eq=False)
class Inertia:
    """Time derivative rate * u - past of a time step: rate (1/s), past (N, 2) (m/s^2) from the steps before."""

    rate: float
    past: np.ndarray


@dataclass(frozen=True)
class Weights:
    """Weights of the parts of the Jacobian beyond the fixed point's: viscous, convective, pressure (seed C 4.1.8)."""

    viscous: float = 1.0
    convective: float = 1.0
    pressure: float = 1.0


@dataclass(frozen=True, eq=False)
class Fields:
    """What a velocity and pressure are at the quadrature points: velocity (C, Q, 2), slopes (C, Q, 4), rate g (C, Q, 3),
    s = |g|^2 + eps^2, pressure and viscosity (C, Q)."""

    velocity: np.ndarray
    slopes: np.ndarray
    rate: np.ndarray
    s: np.ndarray
    pressure: np.ndarray
    viscosity: np.ndarray

    @property
    def stress(self) -> np.ndarray:
        """2 eta g (C, Q, 3)."""
        return 2.0 * self.viscosity[..., None] * self.rate


class QuasiNewtonianFlow:
    """A flow: space, model and conditions.

    Parameters
    ----------
    space : velocities and pressures.
    model : viscosity.
    conditions : by name of the part of the boundary; parts without one are free ("do nothing").
    density : rho (kg/m^3).   force : body force per volume, (2,) or callable x (n, 2) -> (n, 2).
    convection : whether (u . grad) u is kept.
    mean_pressure : of a flow enclosed by walls; 0 when None and the viscosity does not depend on the pressure.

    Raises
    ------
    InputError : an unknown part, a density < 0, data with a net flux into an enclosed domain, a mean pressure for a flow whose
        boundary sets the pressure, a missing or negative one where the viscosity depends on it (seed C 8.2.1).
    """

    def __init__(
        self,
        space: QuadraticSpace,
        model: ViscosityModel,
        conditions: Mapping[str, Condition],
        density: float = 1.0,
        force: Any = None,
        convection: bool = True,
        mean_pressure: float | None = None,
    ) -> None:
        if not (np.isfinite(density) and density >= 0.0):
            raise InputError("density", density, "a finite number >= 0")
        check_parts(space, conditions)
        self.space, self.model, self.conditions = space, model, dict(conditions)
        self.density, self.convection = float(density), bool(convection)
        self.force = force
        self.constraints = constrain(space, self.conditions)
        self.load, self.frictions = self._load(), self._frictions()
        self.mean_pressure = self._mean_pressure(mean_pressure)

    def with_model(self, model: ViscosityModel) -> QuasiNewtonianFlow:
        """The same flow of another fluid."""
        return self._like(self.space, model)

    def transferred(self, space: QuadraticSpace) -> QuasiNewtonianFlow:
        """The same flow on a coarser space of the same hierarchy; fields of the model at points are averaged over its cells."""

        def averaged(values: np.ndarray) -> np.ndarray:
            return np.broadcast_to(values.reshape(space.cells, -1).mean(axis=1)[:, None], space.weights.shape)

        return self._like(space, self.model.at_other_points(averaged))

    def _like(self, space: QuadraticSpace, model: ViscosityModel) -> QuasiNewtonianFlow:
        return QuasiNewtonianFlow(
            space, model, self.conditions, self.density, self.force, self.convection, self.mean_pressure
        )

    # -- conditions --------------------------------------------------------------------------------------------------

    def on(self, space: QuadraticSpace) -> Constraints:
        """The constraints of the same conditions on another space (a coarser level)."""
        return constrain(space, self.conditions)

    @property
    def enclosed(self) -> bool:
        """Whether the pressure is determined up to a constant only."""
        return self.mean_pressure is not None

    def _mean_pressure(self, given: float | None) -> float | None:
        """The mean pressure of an enclosed flow, None for an open one; checked."""
        found = open_parts(self.space, self.constraints)
        self._refuse_negative_pressures(found)
        dependent = self.model.uses_pressure
        if found:
            if given is not None:
                raise InputError("mean_pressure", given, f"left out: the part {found[0]} sets the pressure")
            return None
        if given is None:
            if dependent:
                raise InputError(
                    "mean_pressure",
                    None,
                    "a positive number: the viscosity depends on the pressure and no part of the boundary sets it",
                )
            given = 0.0
        if not np.isfinite(given) or (dependent and given <= 0.0):
            raise InputError("mean_pressure", given, _POSITIVE_PRESSURE)
        self._refuse_net_flux()
        return float(given)

    def _refuse_negative_pressures(self, found: list[str]) -> None:
        """Check what an open boundary sets; `start_pressure` becomes its mean."""
        total = length = 0.0
        for name in found:
            side = self.space.boundary(name)
            values = prescribed_pressure(self.conditions.get(name), side)
            if self.model.uses_pressure and values.min() < 0.0:
                raise InputError(f"conditions.{name}.pressure", float(values.min()), _POSITIVE_PRESSURE)
            total, length = total + float(np.sum(side.weights * values)), length + float(side.weights.sum())
        self.start_pressure = total / length if self.model.uses_pressure and length > 0.0 else 0.0

    def _refuse_net_flux(self) -> None:
        x = self.constraints.impose(np.zeros(self.space.size))
        velocity = x[: 2 * self.space.N].reshape(-1, 2)
        net = total = 0.0
        for name in self.space.mesh.boundaries:
            side = self.space.boundary(name)
            values = np.einsum("fqk,fka->fqa", side.values, velocity[self.space.cell_nodes[side.cells]])
            flux = side.weights * np.einsum("fqa,fqa->fq", values, side.normals)
            net, total = (
                net + float(flux.sum()),
                total + float(np.abs(side.weights * np.linalg.norm(values, axis=2)).sum()),
            )
        if abs(net) > NET_FLUX * max(total, 1e-300):
            raise InputError(
                "conditions",
                f"net flux {net:.3g} through the boundary",
                "without net flux: the fluid is incompressible and enclosed",
            )

    def _frictions(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Cells (F,) and element matrices (F, 2k, 2k) of slip with friction."""
        found = []
        for name, condition in self.conditions.items():
            if isinstance(condition, Slip):
                side = self.space.boundary(name)
                beta = condition.coefficients(side.points.reshape(-1, 2)).reshape(side.weights.shape)
                along = np.eye(2) - side.normals[..., :, None] * side.normals[..., None, :]
                matrices = np.einsum(
                    "fq,fqi,fqab,fqj->fiajb", beta * side.weights, side.values, along, side.values
                )
                size = 2 * self.space.cell_nodes.shape[1]
                found.append((side.cells, matrices.reshape(len(side.cells), size, size)))
        return found

    def _load(self) -> np.ndarray:
        """(size,) work of body forces, boundary stresses and moving slip walls on the shapes."""
        space = self.space
        load = np.zeros((space.N, 2))
        if self.force is not None:
            flat = space.points.reshape(-1, 2)
            value = sampled(self.force, flat, "force", (2,)).reshape(space.points.shape)
            np.add.at(load, space.cell_nodes, np.einsum("cq,qk,cqa->cka", space.weights, space.values, value))
        for name, condition in self.conditions.items():
            side = space.boundary(name)
            flat = side.points.reshape(-1, 2)
            if isinstance(condition, Pressure | Stress):
                tensors = condition.at(flat).reshape(*side.weights.shape, 2, 2)
                traction = np.einsum("fqab,fqb->fqa", tensors, side.normals)
            elif isinstance(condition, ChannelEnd):
                traction = (
                    -sampled(condition.pressure, flat, "pressure").reshape(side.weights.shape)[..., None]
                    * side.normals
                )
            elif isinstance(condition, Slip) and condition.velocity is not None:
                beta = condition.coefficients(flat).reshape(side.weights.shape)
                wall = sampled(condition.velocity, flat, "slip.velocity", (2,)).reshape(side.points.shape)
                wall = wall - side.normals * np.sum(side.normals * wall, axis=2, keepdims=True)
                traction = beta[..., None] * wall
            else:
                continue
            local = np.einsum("fq,fqk,fqa->fka", side.weights, side.values, traction)
            np.add.at(load, space.cell_nodes[side.cells], local)
        return np.concatenate([load.ravel(), np.zeros(space.P)])

    # -- fields ------------------------------------------------------------------------------------------------------

    def at_rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity (N, 2), zero but for prescribed values; pressure (P,), the mean pressure of an enclosed flow, the mean of
        what an open boundary sets where the viscosity depends on it, else zero."""
        x = self.constraints.impose(np.zeros(self.space.size))
        pressure = self.start_pressure if self.mean_pressure is None else self.mean_pressure
        return x[: 2 * self.space.N].reshape(-1, 2), pressure * self.space.unit_pressure

    def fields(self, velocity: np.ndarray, pressure: np.ndarray) -> Fields:
        """Everything at the quadrature points."""
        space = self.space
        shape = space.weights.shape
        u, slopes = np.empty((*shape, 2)), np.empty((*shape, 4))
        sample(space.cell_nodes, space.values, space.gradients, np.ascontiguousarray(velocity), u, slopes)
        rate = np.stack([slopes[..., 0], slopes[..., 3], 0.5 * (slopes[..., 1] + slopes[..., 2])], axis=2)
        s = rate[..., 0] ** 2 + rate[..., 1] ** 2 + 2.0 * rate[..., 2] ** 2 + self.model.eps**2
        p = np.einsum("cqm,cm->cq", space.pressure_values, pressure[space.cell_pressures])
        return Fields(u, slopes, rate, s, p, np.asarray(self.model.viscosity(s, p), dtype=float))

    def rates(self, velocity: np.ndarray) -> np.ndarray:
        """(C, Q, 3) rate of strain (xx, yy, xy) at the quadrature points."""
        return self.fields(velocity, np.zeros(self.space.P)).rate

    def viscosity(self, velocity: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """(C, Q) viscosity at the quadrature points (Pa s)."""
        return self.fields(velocity, pressure).viscosity

    def residual(
        self, fields: Fields, velocity: np.ndarray, inertia: Inertia | None = None, loaded: bool = True
    ) -> np.ndarray:
        """(size,) residual of the weak form, unconstrained: internal less external forces, and -q div u."""
        total = self._summed(self._element_vectors(fields, velocity, inertia))
        return total - self.load if loaded else total

    def rounding(self, fields: Fields, velocity: np.ndarray, inertia: Inertia | None = None) -> float:
        """What rounding may leave of the norm of a residual that vanishes."""
        sizes = self._summed(np.abs(self._element_vectors(fields, velocity, inertia)))
        return ROUNDING * float(np.linalg.norm(sizes))

    def _summed(self, vectors: np.ndarray) -> np.ndarray:
        """(size,) sum of element vectors."""
        return np.bincount(self.space.cell_unknowns.ravel(), vectors.ravel(), minlength=self.space.size)

    def _element_vectors(self, fields: Fields, velocity: np.ndarray, inertia: Inertia | None) -> np.ndarray:
        """(C, n) element vectors of the internal forces."""
        space = self.space
        force = np.zeros_like(fields.velocity)
        u, slopes = fields.velocity, fields.slopes
        if self.convection:
            force[..., 0] = self.density * (u[..., 0] * slopes[..., 0] + u[..., 1] * slopes[..., 1])
            force[..., 1] = self.density * (u[..., 0] * slopes[..., 2] + u[..., 1] * slopes[..., 3])
        if inertia is not None:
            past = np.einsum("qk,cka->cqa", space.values, inertia.past[space.cell_nodes])
            force += self.density * (inertia.rate * u - past)
        vectors = np.empty(space.cell_unknowns.shape)
        momentum_vectors(
            space.values, space.gradients, space.weights, space.pressure_values, fields.stress, fields.pressure,
            force, slopes[..., 0] + slopes[..., 3], vectors,
        )  # fmt: skip
        for cells, matrices in self.frictions:
            local = velocity[space.cell_nodes[cells]].reshape(len(cells), -1)
            np.add.at(vectors[:, : local.shape[1]], cells, np.einsum("fij,fj->fi", matrices, local))
        return vectors

    def jacobian(
        self, fields: Fields, weights: Weights = Weights(), direction: np.ndarray | None = None,
        inertia: Inertia | None = None, out: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """(C, n, n) element matrices of the Jacobian with weighted parts, unconstrained.

        direction : (C, Q, 3) auxiliary direction of the stress-velocity Newton method (see `stress_velocity`).
        """
        space, model = self.space, self.model
        by_s, by_p = model.derivatives(fields.s, fields.pressure)
        first = 4.0 * weights.viscous * by_s[..., None] * fields.rate
        if direction is not None:
            # The yield part of the dyad, -sqrt2 tau_y s^-3/2 g (x) g, with the auxiliary direction for one g / sqrt(s).
            tau = np.sqrt(2.0) * yield_stresses(model, fields.pressure) / fields.s
            first += tau[..., None] * (fields.rate / np.sqrt(fields.s)[..., None] - direction)
        by_pressure = 2.0 * weights.pressure * (by_p * np.ones_like(fields.s))[..., None] * fields.rate
        n = space.cell_unknowns.shape[1]
        out = np.empty((space.cells, n, n)) if out is None else out
        element_matrices(
            space.values, space.gradients, space.weights, space.pressure_values, fields.viscosity,
            first, fields.rate, by_pressure,
            fields.velocity, fields.slopes, self.density,
            weights.convective if self.convection else 0.0, float(self.convection),
            0.0 if inertia is None else inertia.rate, out,
        )  # fmt: skip
        for cells, matrices in self.frictions:
            np.add.at(out[:, : matrices.shape[1], : matrices.shape[1]], cells, matrices)
        return out

    def reaction(
        self, velocity: np.ndarray, pressure: np.ndarray, inertia: Inertia | None = None
    ) -> np.ndarray:
        """(N, 2) nodal forces that the boundary exerts on the fluid: the momentum residual, external loads included."""
        residual = self.residual(self.fields(velocity, pressure), velocity, inertia)
        return residual[: 2 * self.space.N].reshape(-1, 2)


_POSITIVE_PRESSURE = (
    "positive where the viscosity depends on the pressure: a negative pressure would mean a negative or undefined viscosity "
    "in part of the domain, and its value decides the whole flow (seed C 8.2.1)"
)


def yield_stresses(model: ViscosityModel, pressure: np.ndarray) -> np.ndarray:
    """Yield stresses of the model at pressures of any shape, 0 for a model without."""
    found = model.yield_stress(pressure)
    return np.zeros_like(pressure) if found is None else np.broadcast_to(found, pressure.shape)
