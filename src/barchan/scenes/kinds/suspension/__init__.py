"""Grains inside a fluid: the two-phase model by the material point method (seed B, chapter 8)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.scenes.kinds.suspension.report import draw, figures
from barchan.scenes.model import Model


def _model(parameters: SuspensionParameters) -> Model[Any]:
    from barchan.scenes.kinds.suspension.model import SuspensionModel  # only a run needs the compiled flow

    return SuspensionModel(parameters)


def _summary(parameters: SuspensionParameters, results: Results) -> dict[str, Any]:
    from barchan.scenes.kinds.suspension.observables import summarise

    return summarise(parameters, results)


KIND = Kind("suspension", SuspensionParameters, _model, _summary, draw, figures)
