"""Scenes a person runs: validated parameters, geometry, the run itself, observables.

>>> import barchan as bc
>>> scene = bc.scenes.load("collapse", friction=0.5)
>>> run = scene.run(out="runs/gravel")        # doctest: +SKIP
>>> run.summary["run_out"]                     # doctest: +SKIP
"""

from barchan.scenes.loading import preset_names
from barchan.scenes.parameters import SceneParameters
from barchan.scenes.scene import Run, Scene, load

__all__ = ["Run", "Scene", "SceneParameters", "load", "preset_names"]
