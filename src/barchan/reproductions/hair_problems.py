"""Friction problems of hair: steps of small fibre scenes, for the comparisons of seed B 4.2.3.

The seed's own problems (306 steps of a ponytail of 334 Super-Helices; 378 of Super-Helices and Discrete Elastic Rods with 7,000
to 27,000 contacts) are not published.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from barchan import friction, scenes


@dataclass(frozen=True)
class Source:
    """A scene of kind "fibres", overrides of it, and the numbers of the steps to take."""

    name: str
    scene: str
    overrides: Mapping[str, Any]
    steps: tuple[int, ...]


def sources(quick: bool) -> tuple[Source, ...]:
    """A swung wisp and a ponytail on a turning head, of either model of fibres."""
    if quick:
        return (
            Source("wisp", "wisp", {"fibres.count": 30}, (20, 60)),
            Source("wisp-rods", "wisp", {"fibres.count": 20, "fibres.model": "rods", "fibres.segments": 10}, (20, 40)),
        )  # fmt: skip
    rods = {"fibres.model": "rods", "fibres.segments": 14}
    return (
        Source("wisp", "wisp", {"fibres.count": 100}, (40, 120, 200, 320, 480)),
        Source("wisp-rods", "wisp", {"fibres.count": 80, **rods}, (40, 120, 200)),
        Source("ponytail", "ponytail", {"fibres.count": 334}, (20, 80, 130, 180, 240)),
        Source("ponytail-rods", "ponytail", {"fibres.count": 200, **rods}, (20, 80, 130)),
    )


def step_problems(source: Source) -> Iterator[tuple[str, friction.Problem]]:
    """(name, problem) of the wanted steps; every problem is fresh, without the forces of the step before."""
    scene = scenes.load(source.scene, **source.overrides)
    model: Any = scene.model()
    state = model.initial()
    for number in range(1, max(source.steps) + 1):
        dt = model.longest_step(state)
        if number in source.steps:
            yield f"{source.name}-{number}", model.assembly.problem(state, dt)
        if number < max(source.steps):
            state, _ = model.advance(state, dt)


def hair_problems(quick: bool) -> list[tuple[str, friction.Problem]]:
    """All of them, without those that have no contact."""
    found = [entry for source in sources(quick) for entry in step_problems(source)]
    return [(name, problem) for name, problem in found if problem.n > 0]
