"""From the tables of a scene of sand to the materials and options of the flow, and what is to be said about them."""

from __future__ import annotations

from dataclasses import replace

from barchan.errors import InputError
from barchan.flows.mpm import Material, Options, Resampling
from barchan.flows.mpm.advice import advice_on
from barchan.scenes.granular.building import build_options
from barchan.scenes.kinds.sand.parameters import SandParameters


def build_materials(parameters: SandParameters) -> list[Material]:
    """The materials in the order of their tables. Raises InputError for parameters that do not fit each other."""
    return [Material(**table.model_dump()) for table in parameters.all_materials().values()]


def remarks(parameters: SandParameters) -> list[str]:
    """What a person should know before the run: choices that cannot do what they seem to ask for."""
    return advice_on(build_materials(parameters), build_sand_options(parameters))


def build_sand_options(parameters: SandParameters) -> Options:
    """Solver, spaces and transfers of the stepper. Raises InputError for choices that do not exist or do not fit."""
    solver, particles = parameters.solver, parameters.particles
    return replace(
        build_options(solver, particles),
        multilevel=solver.multilevel,
        warm_start=solver.warm_start,
        flip_share=particles.flip_share,
        velocity=particles.velocity,
        stress=particles.stress,
        volume_correction=particles.volume_correction,
        grains=particles.grains,
        resampling=_resampling(parameters),
    )


def _resampling(parameters: SandParameters) -> Resampling | None:
    """Splits and merges, no merged particle being as elongated as one that is split."""
    particles = parameters.particles
    if not particles.resample:
        return None
    ratio = particles.split_ratio
    try:
        return Resampling(split_ratio=ratio, merge_ratio=min(1.5, 0.5 * (1.0 + ratio)))
    except InputError as error:
        raise InputError(f"particles.{error.field.rpartition('.')[2]}", error.value, error.allowed) from None
