"""What makes a kind of scene: the parameters of its files, the model that runs it, its figures and its pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.model import Model
from barchan.scenes.parameters import SceneParameters


@dataclass(frozen=True)
class Kind:
    """A kind of scene.

    Attributes
    ----------
    name : what stands in `[scene] kind`.
    parameters : the tables of its scene files.
    model : parameters -> the simulation. Raises InputError when the flow rejects a parameter.
    summarise : parameters, results -> the figures of summary.json; `converged`, `unconverged_steps`, `steps`,
        `worst_certificate` and `tolerance` are among them.
    draw : parameters, results, summary, an existing folder -> pictures in the folder.
    figures : summary -> (name, value) of the figures that a person asks for first.
    """

    name: str
    parameters: type[SceneParameters]
    model: Callable[[Any], Model[Any]]
    summarise: Callable[[Any, Results], dict[str, Any]]
    draw: Callable[[Any, Results, dict[str, Any], Path], None]
    figures: Callable[[dict[str, Any]], list[tuple[str, str]]]
