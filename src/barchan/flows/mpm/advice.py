"""Choices of materials and options that are allowed but do not do what one may expect, in words (seed B, 7.3.2, 7.3.3)."""

from __future__ import annotations

from collections.abc import Sequence

from barchan.flows.mpm.material import Material
from barchan.flows.mpm.options import Options

# (velocity, stress): no admissible stresses bear every bed that is packed and at rest (seed B, 7.2.1 and 7.3.3).
UNFIT_PAIRS = frozenset({("B2", "Q1"), ("B2", "P1"), ("P1", "Q1"), ("P1", "P1")})
CONTINUOUS = ("Q1", "P1")


def advice_on(materials: Material | Sequence[Material], options: Options) -> list[str]:
    """Sentences to show to whoever starts a simulation with these materials and options; none when all is well."""
    found = (materials,) if isinstance(materials, Material) else tuple(materials)
    texts = []
    lasting = any(material.cohesive and material.cohesion_decay == 0.0 for material in found)
    if lasting and options.stress in CONTINUOUS:
        texts.append(
            f"Cohesion with {options.stress} stresses erodes from the surface: it holds only where a stress stands in packed "
            "matter, and those at the surface, which they share with the cells around, lose it first. Stresses "
            '"particles" or "Q1d" hold cohesive shapes (seed B, 7.3.3), or give a cohesion_decay (7.5.2).'
        )
    if (options.velocity, options.stress) in UNFIT_PAIRS:
        texts.append(
            f"{options.velocity} velocities with {options.stress} stresses do not hold matter at rest: some of its weight is "
            'left unborne at the surface, and it creeps. Stresses "Q1d", "P1d" or "particles" hold it (seed B, 7.2.1).'
        )
    if options.transfer == "flip":
        texts.append(
            "FLIP transfers let particles that fall on matter at rest dive into it: they are told of changes of the grid's "
            'velocity only. "apic" does not (seed B, 7.3.2).'
        )
    return texts
