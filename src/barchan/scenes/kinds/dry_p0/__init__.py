"""Dry grains in a plane box by the mesh-based model: collapsing columns and emptying silos (seed B, 7.2)."""

from __future__ import annotations

from typing import Any

from barchan.scenes.kinds.dry_p0.parameters import DryParameters
from barchan.scenes.kinds.dry_p0.report import draw, figures, summarise
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: DryParameters) -> Model[Any]:
    from barchan.scenes.kinds.dry_p0.model import DryModel  # only a run needs the compiled flow

    return DryModel(parameters)


KIND = Kind("dry_p0", DryParameters, _model, summarise, draw, figures)
