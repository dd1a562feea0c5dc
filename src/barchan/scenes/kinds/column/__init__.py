"""The collapse of a granular column by the material point method (seed B 7.2.3 and 7.5.1)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.column.observables import summarise
from barchan.scenes.kinds.column.parameters import ColumnParameters
from barchan.scenes.kinds.column.report import draw, figures
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: ColumnParameters) -> Model[Any]:
    from barchan.scenes.kinds.column.model import ColumnModel  # only a run needs the compiled flow

    return ColumnModel(parameters)


def _summary(parameters: ColumnParameters, results: Results) -> dict[str, Any]:
    return {
        **summarise(parameters, results.steps, results.observables),
        "particles": len(results.particles(0)["volumes"]),
    }


KIND = Kind("column", ColumnParameters, _model, _summary, draw, figures)
