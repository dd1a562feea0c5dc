"""Super-Helices: fibres made of pieces of constant curvatures and twist (Bertails et al. 2006; seed B, 4.2 and 4.4.1).

lengths, firsts = even_pieces([0.3, 0.3], pieces=5)
model = Helices(lengths, firsts, StillRoots(positions, frames_along(tangents)), radius=4e-5, density=1300.0, young=4e9)
"""

from __future__ import annotations

from barchan.bodies.fibres.helices.model import Helices
from barchan.bodies.fibres.helices.pieces import Pieces, Placed, even_pieces
from barchan.bodies.fibres.helices.shape import HelixShape

__all__ = ["Helices", "HelixShape", "Pieces", "Placed", "even_pieces"]
