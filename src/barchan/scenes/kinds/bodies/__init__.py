"""Rigid bodies in frictional contact, by Moreau and Jean's method or as soft spheres (seed B 2.1-2.2; seed C 3.2)."""

from __future__ import annotations

from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.bodies.parameters import BodiesParameters
from barchan.scenes.kinds.bodies.report import draw, figures
from barchan.scenes.kinds.kind import Kind
from barchan.scenes.model import Model


def _model(parameters: BodiesParameters) -> Model[Any]:
    # only a run needs the compiled kernels
    if parameters.contact.method == "soft":
        from barchan.scenes.kinds.bodies.soft_model import SoftModel

        return SoftModel(parameters)
    from barchan.scenes.kinds.bodies.model import MoreauModel

    return MoreauModel(parameters)


def _summary(parameters: BodiesParameters, results: Results) -> dict[str, Any]:
    from barchan.scenes.kinds.bodies.summary import summarise

    return summarise(parameters, results.steps, results.observables)


KIND = Kind("bodies", BodiesParameters, _model, _summary, draw, figures)
