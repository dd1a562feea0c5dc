"""The parameters of a scene of kind "fibres": fibres in contact with one another and with bodies that move as given.

SI units; the vertical is the last axis; friction coefficients are physical.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.kinds.fibres.entries import (
    FibresGroup,
    InverseGroup,
    ObstacleEntry,
    ObstaclesTable,
    RootsGroup,
)
from barchan.scenes.kinds.sand.entries import Share
from barchan.scenes.kinds.sand.parameters import check_vectors
from barchan.scenes.parameters import (
    Count,
    Group,
    NotNegative,
    ProblemWriting,
    SceneHeader,
    SteppedParameters,
    StepSolver,
)


class FibresHeader(SceneHeader):
    """[scene]"""

    kind: Literal["fibres"] = Field(description="what is simulated: fibres in frictional contact")
    gravity: NotNegative = Field(default=9.81, description="gravity, m/s^2")


class FibresContact(Group):
    """[contact]"""

    friction: NotNegative = Field(default=0.3, description="coefficient between fibres")
    touching: bool = Field(default=True, description="whether fibres touch one another")
    law: Literal["coulomb", "faceted"] = Field(
        default="coulomb", description="exact friction, or a pyramid of four sides: for comparison"
    )
    margin: NotNegative = Field(
        default=0.2,
        description="gap up to which contacts are looked for beyond what a step needs, in radii of the fibres",
    )
    recovery: Share = Field(default=0.2, description="share of an overlap pushed out in a step")
    passes: Count = Field(
        default=2,
        description="most solves of a step, of which each adds contacts that the one before brought about",
    )
    bare: NotNegative = Field(default=0.0, description="length of fibre at the roots that touches nothing, m")


class FibresSolver(StepSolver):
    """[solver]"""

    local_solver: str = Field(
        default="",
        description="of one contact, for sweeps; empty: the method's own",
        json_schema_extra={"accepted": "a name, or nothing"},
    )
    min_sweeps: Annotated[int, Field(ge=0)] = Field(
        default=0, description="fewest solver iterations in a step"
    )


class FibresObserve(ProblemWriting):
    """[observe]"""

    colour: Literal["speed", "fibre"] = Field(default="speed", description="of fibres in pictures")


class FibresParameters(SteppedParameters):
    """A complete scene of kind "fibres"."""

    scene: FibresHeader
    fibres: FibresGroup
    roots: RootsGroup = RootsGroup()
    bodies: ObstaclesTable = ObstaclesTable()
    contact: FibresContact = FibresContact()
    inverse: InverseGroup = InverseGroup()
    solver: FibresSolver = FibresSolver()
    observe: FibresObserve = FibresObserve()

    @property
    def dimension(self) -> int:
        """3."""
        return 3

    @property
    def size(self) -> str:
        """How many fibres, in words."""
        fibres = self.fibres
        words = {"rods": "segments", "helices": "pieces"}[fibres.model]
        bodies = len(list(self.obstacles()))
        touched = f", {bodies} {'body' if bodies == 1 else 'bodies'}" if bodies else ""
        return f"{self.count} fibres of {fibres.segments} {words}{touched}"

    @property
    def count(self) -> int:
        """Number of fibres."""
        return 1 if self.fibres.arrangement == "single" else self.fibres.count

    def obstacles(self) -> Iterator[tuple[str, ObstacleEntry]]:
        """Names and tables of [bodies]."""
        yield from (self.bodies.model_extra or {}).items()

    def check(self) -> None:
        """Raise InputError unless the tables fit together; bodies are checked when they are made."""
        super().check()
        fibres = self.fibres
        check_vectors("fibres", fibres, ("position", "direction"), 3)
        check_vectors("roots", self.roots, ("amplitude", "axis", "pivot"), 3)
        vectors = ("position", "size", "normal", "rotation", "velocity", "spin", "amplitude", "swing")
        for name, body in self.obstacles():
            check_vectors(f"bodies.{name}", body, vectors, 3)
        for key, value in (("fibres.direction", fibres.direction), ("roots.axis", self.roots.axis)):
            if not np.any(value):
                raise InputError(key, value, "a vector that is not zero")
        if fibres.arrangement == "single" and fibres.count != 1:
            raise InputError("fibres.count", fibres.count, "1, or left out, for a single fibre")
        if fibres.arrangement != "ponytail" and fibres.splay_deg:
            raise InputError("fibres.splay_deg", fibres.splay_deg, "0, or left out: only a ponytail spreads")
        shortest = fibres.length * (1.0 - fibres.length_spread)
        if shortest / fibres.segments < fibres.radius:
            allowed = f"at most {shortest / fibres.segments:g}, the length of a segment (m)"
            raise InputError("fibres.radius", fibres.radius, allowed)
        if self.contact.law == "faceted" and self.solver.method != "auto":
            raise InputError("solver.method", self.solver.method, "'auto' for the faceted law")
        sweeping = ("gauss_seidel", "symmetric_gauss_seidel", "sor")
        if self.solver.local_solver and self.solver.method not in sweeping:
            raise InputError(
                "solver.local_solver",
                self.solver.local_solver,
                "empty but for sweeps: " + ", ".join(sweeping),
            )
