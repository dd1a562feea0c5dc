"""Plane chains of segments in maximal, lumped and reduced coordinates, side by side (seed B, 2.1)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.chain.parameters import ChainParameters
from barchan.scenes.kinds.chain.report import draw, figures, summarise
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: ChainParameters) -> Model[Any]:
    # only a run needs the solvers
    from barchan.scenes.kinds.chain.model import ChainsModel

    return ChainsModel(parameters)


def _summary(parameters: ChainParameters, results: Results) -> dict[str, Any]:
    return summarise(parameters, results.steps, results.observables)


KIND = Kind("chain", ChainParameters, _model, _summary, draw, figures)
