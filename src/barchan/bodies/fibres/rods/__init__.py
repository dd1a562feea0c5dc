"""Discrete Elastic Rods (Bergou et al. 2008, 2010): batches of fibres that bend, twist and stretch.

section = Section.circular(4e-5, density=1300.0, young=4e9, poisson=0.4)
rods = Rods([nodes], section, natural="straight", damping=Damping(internal=1e-3))
system = rods.system(rods.started(), dt, gravity)  # for `fibres.assembly`; `at_rest` finds where they hang
"""

from __future__ import annotations

from barchan.bodies.fibres.rods.damping import Damping
from barchan.bodies.fibres.rods.model import Rods
from barchan.bodies.fibres.rods.natural import Natural, laid_out
from barchan.bodies.fibres.rods.section import Section
from barchan.bodies.fibres.rods.shape import RodShape
from barchan.bodies.fibres.rods.statics import Rest, at_rest

__all__ = ["Rods", "RodShape", "Section", "Damping", "Natural", "laid_out", "at_rest", "Rest"]
