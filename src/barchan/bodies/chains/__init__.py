"""Plane chains of segments in three descriptions: maximal, lumped and reduced coordinates (seed B, 2.1).

chain = Chain(segments=3, half_lengths=0.5, line_density=1.0, angles=0.0)
model = MaximalChain(chain)                     # or LumpedChain, ReducedChain: the same motion
state = model.started()
state, record = model.advance(state, 1e-3)
model.tip(state), model.kinetic_energy(state), model.potential_energy(state)
"""

from __future__ import annotations

from barchan.bodies.chains.chain import Chain
from barchan.bodies.chains.lumped import LumpedChain
from barchan.bodies.chains.maximal import MaximalChain
from barchan.bodies.chains.model import ChainModel
from barchan.bodies.chains.options import ChainOptions
from barchan.bodies.chains.reduced import ReducedChain
from barchan.bodies.chains.reference import ReferenceMotion, slowest_period
from barchan.bodies.chains.state import ChainState

CHAIN_MODELS: dict[str, type[ChainModel]] = {
    "maximal": MaximalChain,
    "lumped": LumpedChain,
    "reduced": ReducedChain,
}
"""The descriptions by name."""

__all__ = [
    "CHAIN_MODELS",
    "Chain",
    "ChainModel",
    "ChainOptions",
    "ChainState",
    "LumpedChain",
    "MaximalChain",
    "ReducedChain",
    "ReferenceMotion",
    "slowest_period",
]
