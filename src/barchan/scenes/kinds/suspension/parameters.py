"""The parameters of a scene of kind "suspension": grains inside a fluid that fills a box (seed B, chapter 8).

SI units; the vertical is the last axis; friction coefficients are physical (ERRATA 1).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.granular.parameters import Box, GranularParameters
from barchan.scenes.kinds.sand.parameters import check_vectors
from barchan.scenes.kinds.suspension.entries import (
    DragGroup,
    FluidGroup,
    GrainsGroup,
    SidesGroup,
    SuspendedMatter,
    SuspendedPiece,
    SuspensionObserve,
    SuspensionParticles,
    SuspensionSolver,
    SuspensionTime,
    ViscosityGroup,
)
from barchan.scenes.parameters import NotNegative, SceneHeader


class SuspensionHeader(SceneHeader):
    """[scene]"""

    kind: Literal["suspension"] = Field(description="what is simulated: grains inside a fluid")
    gravity: NotNegative = Field(default=9.81, description="gravity, downwards along the last axis, m/s^2")


class SuspensionParameters(GranularParameters):
    """A complete scene of kind "suspension"."""

    scene: SuspensionHeader
    box: Box
    grains: GrainsGroup
    fluid: FluidGroup = FluidGroup()
    drag: DragGroup = DragGroup()
    viscosity: ViscosityGroup = ViscosityGroup()
    matter: SuspendedMatter
    sides: SidesGroup = SidesGroup()
    time: SuspensionTime
    solver: SuspensionSolver = SuspensionSolver()
    particles: SuspensionParticles = SuspensionParticles()
    observe: SuspensionObserve = SuspensionObserve()

    def pieces(self) -> Iterator[tuple[str, SuspendedPiece]]:
        """Names and tables of the pieces of matter."""
        yield from (self.matter.model_extra or {}).items()

    @property
    def height(self) -> float:
        """Height of the box (m)."""
        return self.box.size[-1]

    @property
    def ground(self) -> float:
        """Area of the floor (m^2), in the plane its length (m)."""
        return self.box.size[0] * (self.box.size[1] if self.dimension == 3 else 1.0)

    @property
    def length_scale(self) -> float:
        """L of the dimensionless numbers (m)."""
        observe = self.observe
        return observe.scale or observe.height or self.height

    @classmethod
    def completed(cls, tables: dict[str, Any]) -> dict[str, Any]:
        """In 3D, side walls that are not given slip."""
        size, sides = tables.get("box", {}).get("size"), tables.get("sides", {})
        if isinstance(size, list) and len(size) == 3 and isinstance(sides, dict):
            tables["sides"] = {"y_min": "slip", "y_max": "slip", **sides}
        return tables

    def check(self) -> None:
        """Raise InputError unless the tables fit together; what the flow itself checks is left to it."""
        self.check_box(self.sides, "sides")
        if not list(self.pieces()):
            raise InputError("matter", "empty", "a table [matter.NAME] with keys shape, position, ...")
        for name, piece in self.pieces():
            check_vectors(f"matter.{name}", piece, ("position", "size", "velocity"), self.dimension)
            _check_ripple(f"matter.{name}", piece)
        observe = self.observe
        if (observe.length is None) != (observe.height is None):
            missing = "length" if observe.length is None else "height"
            raise InputError(f"observe.{missing}", "missing", "given with the other of length and height, m")


def _check_ripple(field: str, piece: SuspendedPiece) -> None:
    """Only an upright box has a face with a wave, which is lower than the box."""
    if piece.ripple == 0.0:
        return
    if piece.shape != "box" or piece.rotation is not None:
        raise InputError(f"{field}.ripple", piece.ripple, "0 but for a box that is not turned")
    if piece.size is not None and abs(piece.ripple) >= piece.size[-1]:
        raise InputError(
            f"{field}.ripple", piece.ripple, f"less than the height of the box, {piece.size[-1]:g} m"
        )
