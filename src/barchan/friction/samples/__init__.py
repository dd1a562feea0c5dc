"""Frictional problems made to measure: seeded random ones with a known answer, piles of discs and spheres, families of both.

Seed B 2.2 (Moreau-Jean linear terms), 2.3.2 (existence), 4.1 (conditioning ratio n d / m). The same seed gives the same bytes.
"""

from barchan.friction.samples.families import FAMILIES, family
from barchan.friction.samples.known import Sample, sample
from barchan.friction.samples.piles import Pile, pile

__all__ = ["FAMILIES", "Pile", "Sample", "family", "pile", "sample"]
