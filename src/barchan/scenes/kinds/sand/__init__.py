"""Grains and rigid bodies in a box by the material point method: heaps, silos, impacts, tools (seed B 7.5)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.kinds.sand.parameters import SandParameters
from barchan.scenes.kinds.sand.report import draw, figures
from barchan.scenes.model import Model


def _model(parameters: SandParameters) -> Model[Any]:
    from barchan.scenes.kinds.sand.model import SandModel  # only a run needs the compiled flow

    return SandModel(parameters)


def _summary(parameters: SandParameters, results: Results) -> dict[str, Any]:
    from barchan.scenes.kinds.sand.observables import summarise

    return summarise(parameters, results.steps, results.observables)


KIND = Kind("sand", SandParameters, _model, _summary, draw, figures)
