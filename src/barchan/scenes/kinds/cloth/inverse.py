"""The inverse problem of a scene of kind "cloth": the rest shape that keeps the cloth where it starts (seed B 4.4.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.parameters import Count, Group, NotNegative, Positive

if TYPE_CHECKING:
    from barchan.bodies.cloth import Cloth, ClothAssembly
    from barchan.bodies.inverse.rest_shape import RestShape

STAGES = (1e-1, 1e-2, 1e-3)
UNUSABLE = 0.05


class InverseGroup(Group):
    """[inverse]: whether the start is what an artist has drawn, at rest under weight and contact."""

    rest_shape: bool = Field(
        default=False, description="whether the rest shape is looked for with which the start is at rest"
    )
    reach: NotNegative = Field(default=1e-4, description="gap up to which the start touches a body, m")
    friction_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=0.8, description="share of the friction coefficients that the start may need"
    )
    iterations: Count = Field(default=60, description="most descent steps at each of three proximal terms")
    imbalance: Positive = Field(
        default=1e-3, description="force at the start that friction may leave over, over the weight"
    )
    regularisation: NotNegative = Field(
        default=0.0, description="cost of a rest shape away from the start over that of a drape away from it"
    )


def found_rest_shape(group: InverseGroup, assembly: ClothAssembly) -> RestShape:
    """The rest shape of the cloth of an assembly, at its start in contact with bodies only."""
    from barchan.bodies.cloth.obstacles import Obstacles
    from barchan.bodies.inverse.drape import Drape
    from barchan.bodies.inverse.rest_shape import RestShapeOptions, rest_shape

    cloth, state = assembly.cloth, assembly.started()
    material, n = cloth.material, len(cloth)
    obstacles = Obstacles(
        assembly.bodies,
        group.friction_share * material.friction,
        assembly.options.mixing,
        0.5 * material.thickness,
    )
    loose = ~cloth.pinned.mask
    reach = np.full(n, group.reach)
    contacts = obstacles.contacts(cloth.positions, reach, state.bodies, state.bodies, 1.0, loose)
    drape = Drape(
        cloth.energy, cloth.masses, assembly.acceleration, cloth.positions, contacts, cloth.pinned.mask
    )
    options = RestShapeOptions(
        proximal=STAGES,
        iterations=group.iterations,
        imbalance=group.imbalance,
        regularisation=group.regularisation,
    )
    return rest_shape(drape, options=options)


def with_rest_shape(group: InverseGroup, assembly: ClothAssembly) -> Cloth:
    """The cloth with the rest shape that keeps it where it starts.

    Raises InputError for a cloth that may touch itself, and a start that no rest shape found comes near to keeping.
    """
    if assembly.options.self_contact:
        raise InputError("inverse.rest_shape", True, "false for a cloth that may touch itself")
    found = found_rest_shape(group, assembly)
    if found.imbalance > max(UNUSABLE, group.imbalance):
        needs = f"more, or another start: it still needs {found.imbalance:.2g} of the weight beyond what friction can bear"
        raise InputError("inverse.iterations", group.iterations, needs)
    return assembly.cloth.with_rest(found.rest)
