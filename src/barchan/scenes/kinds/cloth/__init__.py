"""A cloth in frictional contact with bodies that move as given, and with itself (seed B, 4.3)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.cloth.parameters import ClothParameters
from barchan.scenes.kinds.cloth.report import draw, figures
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: ClothParameters) -> Model[Any]:
    # only a run needs the compiled kernels
    from barchan.scenes.kinds.cloth.model import ClothModel

    return ClothModel(parameters)


def _summary(parameters: ClothParameters, results: Results) -> dict[str, Any]:
    from barchan.scenes.kinds.cloth.summary import summarise

    return summarise(parameters, results.steps, results.observables)


KIND = Kind("cloth", ClothParameters, _model, _summary, draw, figures)
