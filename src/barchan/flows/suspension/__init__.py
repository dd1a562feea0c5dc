"""Granular matter inside a Newtonian fluid: the two-phase model (seed B, chapter 8)."""

from __future__ import annotations

from barchan.flows.suspension.checks import notes
from barchan.flows.suspension.drag import CarmanKozeny, Drag, Quadratic, RichardsonZaki
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.numbers import Numbers, numbers
from barchan.flows.suspension.options import Options
from barchan.flows.suspension.sides import Side, Sides
from barchan.flows.suspension.state import SuspensionRecord, SuspensionState
from barchan.flows.suspension.stepper import Suspension
from barchan.flows.suspension.viscosity import (
    Constant,
    EffectiveViscosity,
    Einstein,
    FrankelAcrivos,
    KriegerDougherty,
)

__all__ = [
    "CarmanKozeny",
    "Constant",
    "Drag",
    "EffectiveViscosity",
    "Einstein",
    "FrankelAcrivos",
    "KriegerDougherty",
    "Mixture",
    "Numbers",
    "Options",
    "Quadratic",
    "RichardsonZaki",
    "Side",
    "Sides",
    "Suspension",
    "SuspensionRecord",
    "SuspensionState",
    "notes",
    "numbers",
]
