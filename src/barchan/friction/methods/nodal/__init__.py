"""The nodal algorithm for contacts of vertices (seed B 4.3.1, 4.3.3): in velocities, with M and without its inverse."""

from barchan.friction.methods.nodal.form import applicable, nodal_form
from barchan.friction.methods.nodal.method import nodal

__all__ = ["applicable", "nodal", "nodal_form"]
