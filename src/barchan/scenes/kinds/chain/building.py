"""The chain, its obstacles and its models from the tables of a scene; errors name the keys of the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.chains import CHAIN_MODELS, Chain, ChainModel, ChainOptions
from barchan.bodies.rigid import Body, Fixed, HalfSpace, Sphere
from barchan.errors import InputError
from barchan.friction import methods
from barchan.scenes.kinds.chain.parameters import ChainParameters

_KEYS = {"line_density": "line_densities", "clamp_angle": "clamp", "masses": "line_densities"}


def build_chain(parameters: ChainParameters) -> Chain:
    """The chain of [chain]."""
    given = parameters.chain
    try:
        return Chain(
            given.segments, _per_segment(given.half_lengths), line_density=_per_segment(given.line_densities),
            angles=np.radians(_per_segment(given.angles)), spins=np.radians(_per_segment(given.spins)),
            bending_stiffness=given.bending_stiffness, air_friction=given.air_friction, held=given.held,
            root=given.root, velocity=given.velocity, gravity=parameters.scene.gravity, inertia=given.inertia,
            clamp_angle=None if given.clamp is None else float(np.radians(given.clamp)), friction=given.friction,
        )  # fmt: skip
    except InputError as error:
        key = error.field.rpartition(".")[2]
        raise InputError(f"chain.{_KEYS.get(key, key)}", error.value, error.allowed) from None


def build_obstacles(parameters: ChainParameters) -> list[Body]:
    """The bodies of [obstacles]. Raises InputError for a plane without direction."""
    bodies = []
    for name, entry in parameters.obstacle_tables():
        if entry.shape == "plane" and not np.any(entry.normal):
            raise InputError(f"obstacles.{name}.normal", entry.normal, "a vector that is not zero")
        shape = (
            HalfSpace(entry.normal) if entry.shape == "plane" else Sphere(entry.radius or 0.0, dimension=2)
        )
        bodies.append(
            Body(shape, name=name, friction=entry.friction, position=entry.position, motion=Fixed())
        )
    return bodies


def build_models(parameters: ChainParameters) -> dict[str, ChainModel]:
    """The models of [solver], by name."""
    solver = parameters.solver
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    options = ChainOptions(
        iterations=solver.iterations,
        tolerance=solver.tolerance,
        method=solver.method,
        max_sweeps=solver.max_sweeps,
    )
    chain, obstacles = build_chain(parameters), build_obstacles(parameters)
    return {name: CHAIN_MODELS[name](chain, obstacles, options) for name in parameters.model_names}


def _per_segment(values: list[float]) -> NDArray[np.float64] | float:
    return values[0] if len(values) == 1 else np.array(values, dtype=np.float64)
