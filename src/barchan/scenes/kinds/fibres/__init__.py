"""Fibres in frictional contact: Discrete Elastic Rods or Super-Helices, with bodies that move as given (seed B, 4.2)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.fibres.parameters import FibresParameters
from barchan.scenes.kinds.fibres.report import draw, figures
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: FibresParameters) -> Model[Any]:
    # only a run needs the compiled kernels
    from barchan.scenes.kinds.fibres.model import FibresModel

    return FibresModel(parameters)


def _summary(parameters: FibresParameters, results: Results) -> dict[str, Any]:
    from barchan.scenes.kinds.fibres.summary import summarise

    return summarise(parameters, results.steps, results.observables)


KIND = Kind("fibres", FibresParameters, _model, _summary, draw, figures)
