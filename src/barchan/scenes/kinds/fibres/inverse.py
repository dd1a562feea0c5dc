"""Fibres that hang as they are groomed: their natural shapes from their shape at rest (seed B, 4.4.1).

The groom of a scene is where its fibres come to rest, with the natural curls of [fibres], under weight and contact while
nothing is moved. These curls are then forgotten, and found again; or not, to show how a groom is lost without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from barchan.bodies.fibres.assembly import FibreAssembly
from barchan.bodies.fibres.helices import Helices
from barchan.bodies.fibres.model import Vector
from barchan.bodies.fibres.roots import StillRoots
from barchan.bodies.inverse.natural_shape import InverseOptions, hanging
from barchan.bodies.rigid import Body, Fixed
from barchan.errors import InputError
from barchan.scenes.kinds.fibres.parameters import FibresParameters

_AT_REST = 1e-3  # m/s, of the fastest node of a groom
_DAMPING = 0.1  # s, internal while coming to rest: no oscillation of hair lasts


def groomed(parameters: FibresParameters, assembly: FibreAssembly[Any]) -> FibreAssembly[Any]:
    """The assembly as [inverse] asks: its fibres start in their groom, with natural shapes that keep them there or not.

    Raises InputError for rods, or fibres that are not at rest after `inverse.settle`.
    """
    asked = parameters.inverse
    if asked.target == "off":
        return assembly
    model = assembly.model
    if not isinstance(model, Helices):
        raise InputError("fibres.model", parameters.fibres.model, '"helices" for [inverse]')
    groom = _at_rest(parameters, assembly, model)
    sagging = model.with_natural(groom, groom)
    if asked.target == "unaware":
        return replace(assembly, model=sagging)
    options = InverseOptions(
        target=asked.target,
        metric=asked.metric,
        regularisation=asked.regularisation,
        tolerance=asked.tolerance,
    )
    still = replace(assembly, model=replace(sagging, roots=_still(model)), bodies=_fixed(assembly.bodies))
    _, found = hanging(still, parameters.time.step, options)
    return replace(assembly, model=model.with_natural(found.natural, groom))


def _at_rest(parameters: FibresParameters, assembly: FibreAssembly[Any], model: Helices) -> Vector:
    """(p, 3) twists and curvatures where the fibres come to rest, nothing being moved."""
    damped = replace(model, roots=_still(model), internal_damping=max(model.internal_damping, _DAMPING))
    settling = replace(assembly, model=damped, bodies=_fixed(assembly.bodies))
    state, dt = settling.started(), parameters.time.step
    fastest = np.inf
    for _ in range(round(parameters.inverse.settle / dt)):
        state, record = settling.advance(state, dt)
        fastest = record.max_speed
    if not fastest <= _AT_REST:
        allowed = f"longer: the fibres still move at {fastest:.2g} m/s, and a groom at {_AT_REST:g} at most"
        raise InputError("inverse.settle", parameters.inverse.settle, allowed)
    return np.asarray(state.shape.curvatures)


def _still(model: Helices) -> StillRoots:
    """The roots, staying where they start."""
    return StillRoots(*model.roots.at(0.0))


def _fixed(bodies: Sequence[Body]) -> list[Body]:
    """The bodies, staying where they start."""
    return [
        Body(
            b.shape,
            name=b.name,
            friction=b.friction,
            position=b.position,
            rotation=b.rotation,
            motion=Fixed(),
        )
        for b in bodies
    ]
