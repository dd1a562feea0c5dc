"""Viscosities of generalised Newtonian fluids, eta(|g|, p), with their analytic derivatives (seed C, Eq. 3.3-3.8 and 6.15).

Each model is a frozen dataclass. |g|^2 = g:g, g = D(u), enters as s = |g|^2 + eps^2 (ERRATA 6); the deviatoric stress is
sigma = 2 eta g. A new model is a `UserModel` with one function and one derivative; `check_derivatives` tests any of them.
"""

from __future__ import annotations

from barchan.flows.quasi_newtonian.models.base import ViscosityModel
from barchan.flows.quasi_newtonian.models.custom import UserModel, check_derivatives
from barchan.flows.quasi_newtonian.models.granular import ModifiedPoliquen, Poliquen, Schaeffer, Tardos
from barchan.flows.quasi_newtonian.models.viscous import Bingham, HerschelBulkley, Newtonian, PowerLaw

__all__ = [
    "Bingham",
    "HerschelBulkley",
    "ModifiedPoliquen",
    "Newtonian",
    "Poliquen",
    "PowerLaw",
    "Schaeffer",
    "Tardos",
    "UserModel",
    "ViscosityModel",
    "check_derivatives",
]
