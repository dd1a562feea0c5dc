"""The parameters of a scene of kind "bodies": bodies in frictional contact, in the plane or in space.

SI units; the vertical is the last axis; friction coefficients are physical. In the plane, masses are per metre of depth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.kinds.bodies.entries import (
    BodiesTable,
    BodyEntry,
    GeneratorEntry,
    GeneratorsTable,
    JointEntry,
    JointsTable,
)
from barchan.scenes.kinds.sand.entries import Share, rows_key, vector_key
from barchan.scenes.kinds.sand.parameters import check_vectors
from barchan.scenes.parameters import (
    Group,
    NotNegative,
    Positive,
    ProblemWriting,
    SceneHeader,
    SteppedParameters,
    StepSolver,
    StepTime,
)


class BodiesHeader(SceneHeader):
    """[scene]"""

    kind: Literal["bodies"] = Field(description="what is simulated: rigid bodies in frictional contact")
    dimension: Literal[2, 3] = Field(description="of space")
    gravity: NotNegative = Field(default=9.81, description="gravity, m/s^2")
    slope_deg: Annotated[float, Field(gt=-90.0, lt=90.0)] = Field(
        default=0.0, description="gravity is turned so that horizontal ground falls along x, degrees"
    )


class ContactGroup(Group):
    """[contact]"""

    method: Literal["moreau", "soft"] = Field(
        default="moreau", description="rigid bodies by Moreau-Jean steps, or spheres on springs and dashpots"
    )
    mixing: Literal["geometric", "mean", "min", "max"] = Field(
        default="geometric", description="friction of a pair from the coefficients of both"
    )
    pairs: list[list[str | float]] | None = rows_key(
        "friction of certain pairs", "rows [name, name, coefficient]"
    )
    restitution: Share = Field(default=0.0, description="Newton's coefficient of impacts; soft: above 0")
    tangential_restitution: Share = Field(default=0.0, description="likewise along the contact (moreau)")
    rest_speed: NotNegative = Field(
        default=0.0, description="approaches slower than this do not rebound (moreau), m/s"
    )
    recovery: Share = Field(default=0.2, description="share of an overlap pushed out in a step (moreau)")
    margin: NotNegative = Field(
        default=0.0,
        description="gap up to which contacts are looked for beyond what a step needs (moreau), m",
    )
    allowed_overlap: Share = Field(
        default=1e-6, description="of bodies at the start, of the smallest size of a free body"
    )
    relax: Annotated[int, Field(ge=0)] = Field(
        default=0, description="steps that may push bodies apart that overlap more at the start (moreau)"
    )
    law: Literal["hookean", "hertzian"] = Field(default="hookean", description="of soft contacts")
    stiffness: Positive = Field(default=1e5, description="of a hookean contact, N/m (2D: N/m per metre)")
    young_modulus: Positive = Field(default=1e7, description="of hertzian contacts, Pa")
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5)] = Field(
        default=0.3, description="of hertzian contacts"
    )
    largest_speed: Positive | None = Field(
        default=None, description="of collisions of hertzian contacts: sets the steps, m/s"
    )
    steps_per_contact: Annotated[int, Field(ge=10)] = Field(
        default=50, description="steps in the shortest soft contact"
    )
    rolling_friction: NotNegative = Field(default=0.0, description="of soft contacts")
    most_overlap: Share = Field(
        default=0.05, description="of the smallest radius, above which soft contacts count as too soft"
    )


class CellGroup(Group):
    """[cell]"""

    size: list[Positive] | None = vector_key("a periodic cell with a corner at the origin (soft), m")
    shear_rate: float = Field(default=0.0, description="du_x/dz of its images (Lees and Edwards), 1/s")
    pressure: NotNegative = Field(
        default=0.0, description="that its height is moved to keep, Pa; 0: the height is fixed"
    )


class BodiesTime(StepTime):
    """[time]"""

    step: Positive = Field(description="time step; soft: time between records, of many steps, s")
    rest_speed: NotNegative = Field(
        default=0.0, description="the run ends at a frame when nothing is faster than this, m/s; 0: never"
    )


class BodiesSolver(StepSolver):
    """[solver]"""

    min_sweeps: Annotated[int, Field(ge=0)] = Field(
        default=0, description="fewest solver iterations in a step"
    )
    theta: Annotated[float, Field(ge=0.5, le=1.0)] = Field(
        default=1.0, description="share of the end velocity in the moves of a step"
    )


class BodiesObserve(ProblemWriting):
    """[observe]"""

    length: Positive | None = Field(default=None, description="length L0 that run-outs are relative to, m")
    height: Positive | None = Field(default=None, description="height H0 that heights are relative to, m")
    back: float = Field(default=0.0, description="abscissa that the front is measured from, m")
    level: float | None = Field(
        default=None,
        description="the mass of free bodies above this height and its discharge are measured, m",
    )
    surface: list[float] | None = rows_key(
        "the slope of the surface between these abscissae is measured, m", "two numbers"
    )
    sliding: str = Field(
        default="",
        description="body whose speed is compared with that of a block sliding down the slope on `ground`",
        json_schema_extra={"accepted": "a name"},
    )
    ground: str = Field(default="", description="see `sliding`", json_schema_extra={"accepted": "a name"})
    colour: Literal["speed", "size"] = Field(default="speed", description="of bodies in pictures")


class BodiesParameters(SteppedParameters):
    """A complete scene of kind "bodies"."""

    scene: BodiesHeader
    bodies: BodiesTable = BodiesTable()
    generators: GeneratorsTable = GeneratorsTable()
    joints: JointsTable = JointsTable()
    contact: ContactGroup = ContactGroup()
    cell: CellGroup = CellGroup()
    time: BodiesTime
    solver: BodiesSolver = BodiesSolver()
    observe: BodiesObserve = BodiesObserve()

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.scene.dimension

    @property
    def size(self) -> str:
        """How many bodies, in words."""
        made = [entry.kind for _, entry in self.makers()]
        grains = sum(entry.count for _, entry in self.makers() if entry.kind in ("grains", "stack"))
        single = len(list(self.single_bodies()))
        words = [f"{grains} grains or boxes"] if grains else []
        words += ["a card house"] if "card_house" in made else []
        words += [f"{single} bodies"] if single else []
        return ", ".join(words)

    @property
    def gravity_vector(self) -> list[float]:
        """Gravity (d,) m/s^2, turned by the slope."""
        angle, g = math.radians(self.scene.slope_deg), self.scene.gravity
        across = [0.0] * (self.dimension - 2)
        return [g * math.sin(angle), *across, -g * math.cos(angle)]

    def single_bodies(self) -> Iterator[tuple[str, BodyEntry]]:
        """Names and tables of [bodies]."""
        yield from (self.bodies.model_extra or {}).items()

    def makers(self) -> Iterator[tuple[str, GeneratorEntry]]:
        """Names and tables of [generators]."""
        yield from (self.generators.model_extra or {}).items()

    def joint_tables(self) -> Iterator[tuple[str, JointEntry]]:
        """Names and tables of [joints]."""
        yield from (self.joints.model_extra or {}).items()

    def check(self) -> None:
        """Raise InputError unless the tables fit together; bodies are checked when they are made."""
        super().check()
        d = self.dimension
        if not [*self.single_bodies(), *self.makers()]:
            raise InputError("bodies", "empty", "a table [bodies.NAME] or [generators.NAME]")
        vectors = ("position", "size", "velocity", "force", "normal")
        for name, body in self.single_bodies():
            check_vectors(f"bodies.{name}", body, vectors, d)
        for name, maker in self.makers():
            check_vectors(f"generators.{name}", maker, ("lower", "upper", "position", "velocity", "size"), d)
        for name, joint in self.joint_tables():
            check_vectors(f"joints.{name}", joint, ("anchor", "second_anchor", "axis"), d)
        self._check_contact()
        self._check_observed()

    def _check_contact(self) -> None:
        contact, cell = self.contact, self.cell
        for row in contact.pairs or []:
            if len(row) != 3 or not isinstance(row[2], float | int) or row[2] < 0.0:
                raise InputError("contact.pairs", row, "rows [name, name, coefficient >= 0]")
        if contact.method == "moreau":
            if cell.size is not None:
                raise InputError("cell.size", cell.size, "left out: only soft spheres know periodic cells")
            return
        if contact.restitution == 0.0:
            raise InputError("contact.restitution", 0.0, "above 0 for soft contacts")
        if contact.pairs is not None:
            raise InputError("contact.pairs", contact.pairs, "left out for soft contacts")
        if contact.relax:
            raise InputError("contact.relax", contact.relax, "0 for soft contacts")
        if contact.law == "hertzian" and contact.largest_speed is None:
            raise InputError("contact.largest_speed", "missing", "given for hertzian contacts, m/s")
        if list(self.joint_tables()):
            raise InputError("joints", "given", "left out for soft contacts")
        if self.observe.write_problems_every:
            raise InputError(
                "observe.write_problems_every", self.observe.write_problems_every, "0 for soft contacts"
            )
        check_vectors("cell", cell, ("size",), self.dimension)
        if cell.size is None and (cell.shear_rate or cell.pressure):
            raise InputError("cell.size", "missing", "given with cell.shear_rate or cell.pressure, m")

    def _check_observed(self) -> None:
        observe = self.observe
        if (observe.length is None) != (observe.height is None):
            missing = "length" if observe.length is None else "height"
            raise InputError(f"observe.{missing}", "missing", "given with the other of length and height, m")
        if observe.surface is not None and (
            len(observe.surface) != 2 or observe.surface[0] >= observe.surface[1]
        ):
            raise InputError("observe.surface", observe.surface, "two increasing numbers, m")
        if bool(observe.sliding) != bool(observe.ground):
            missing = "sliding" if not observe.sliding else "ground"
            raise InputError(f"observe.{missing}", "missing", "given with the other of sliding and ground")
