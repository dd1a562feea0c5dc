"""Rest shapes of shells from their shape at rest under weight and contact (seed B 4.4.2; Casati et al. 2016).

min over p of J(p) = |Phi(p) - t|^2 / 2 + e |p - p0|^2 / 2, Phi the draping function of `drape`, t the target, by L-BFGS. At
Phi(p) = t the proximal term of the draping has no force: the target is at rest whatever its weight was. That weight falls by
stages; each starts from the rest shape of the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.inverse._descent import descend
from barchan.bodies.inverse.drape import Drape, Draped
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class RestShapeOptions:
    """How a rest shape is looked for.

    proximal : 1 / lambda of each stage, over the mean diagonal of the Hessian; decreasing.
    regularisation : e, a rest shape a metre away costing as much as e times a drape a metre away; >= 0.
    iterations : L-BFGS steps of a stage.
    tolerance : ends a stage; root mean square distance of drape and target [m].
    imbalance : ends everything; force that friction cannot balance at the target, over the weight.
    draping : relative tolerance of a draping, Newton steps at most.

    Raises InputError for a value out of range.
    """

    proximal: tuple[float, ...] = (1e-1, 1e-2, 1e-3)
    regularisation: float = 0.0
    iterations: int = 40
    tolerance: float = 1e-7
    imbalance: float = 1e-4
    draping: tuple[float, int] = (1e-7, 60)

    def __post_init__(self) -> None:
        stages = np.asarray(self.proximal, dtype=float)
        if stages.ndim != 1 or not len(stages) or not np.isfinite(stages).all() or (stages <= 0.0).any():
            raise InputError("proximal", self.proximal, "numbers > 0, one at least")
        if (np.diff(stages) > 0.0).any():
            raise InputError("proximal", self.proximal, "decreasing")
        inputs.not_negative("regularisation", self.regularisation)
        inputs.positive("tolerance", self.tolerance)
        inputs.positive("imbalance", self.imbalance)
        inputs.positive("draping", self.draping[0])
        for name, count in (("iterations", self.iterations), ("draping", self.draping[1])):
            if isinstance(count, bool) or not isinstance(count, int) or count < 1:
                raise InputError(name, count, "a whole number >= 1")


@dataclass(frozen=True, eq=False)
class RestShape:
    """What was found.

    rest : (n, 3) rest positions [m].  drape : their equilibrium under the last proximal term.
    distance : root mean square of drape and target [m].  imbalance : force at the target that friction cannot balance, over the
    weight, and that of the first guess.  history : (stage, step, J [m^2]).  drapings : how many equilibria were computed.
    """

    rest: Vector
    drape: Draped
    distance: float
    imbalance: float
    first_imbalance: float
    drapings: int
    history: list[tuple[int, int, float]] = field(default_factory=list)


def rest_shape(
    drape: Drape, guess: Vector | None = None, options: RestShapeOptions | None = None
) -> RestShape:
    """The rest shape whose drape is the target of `drape`, from a guess p0 (n, 3) (the target itself).

    A rest shape that cannot be draped (a triangle without area) is refused by the line search. Raises InputError for a guess
    of the wrong size.
    """
    options = RestShapeOptions() if options is None else options
    target = drape.target
    start = np.array(target if guess is None else guess, dtype=float)
    if start.shape != target.shape or not np.isfinite(start).all():
        raise InputError("guess", start.shape, f"finite positions of shape {target.shape}")
    search = _Search(drape, start, options)
    rest = start
    for stage in range(len(options.proximal)):
        rest = search.stage(stage, rest)
        if drape.imbalance(rest) <= options.imbalance:
            break
    found = search.drape_of(rest)
    distance = math.sqrt(float(np.sum((found.positions - target) ** 2)) / len(target))
    return RestShape(
        rest, found, distance, drape.imbalance(rest), drape.imbalance(start), search.drapings, search.history
    )


class _Search:
    """The function J of a stage, and what it cost."""

    def __init__(self, drape: Drape, guess: Vector, options: RestShapeOptions) -> None:
        self.drape, self.guess, self.options = drape, guess, options
        self.proximal = options.proximal[0] / drape.step
        self.start, self.drapings = drape.target, 0
        self.history: list[tuple[int, int, float]] = []

    def stage(self, number: int, rest: Vector) -> Vector:
        """L-BFGS at the proximal term of a stage; the rest shape it ends with."""
        self.proximal = self.options.proximal[number] / self.drape.step
        self.start = self.drape.target
        n = len(self.guess)

        def watch(step: int, value: float, x: Vector) -> bool:
            self.history.append((number, step, value))
            self.start = self.last.positions
            away = math.sqrt(float(np.sum((self.last.positions - self.drape.target) ** 2)) / n)
            return (
                away <= self.options.tolerance
                or self.drape.imbalance(x.reshape(n, 3)) <= self.options.imbalance
            )

        found = descend(self.value, self.gradient, rest.reshape(-1), 1.0, watch, self.options.iterations)
        return found.reshape(n, 3)

    def drape_of(self, rest: Vector) -> Draped:
        """Phi(rest), from the drape of the last accepted step."""
        self.drapings += 1
        tolerance, most = self.options.draping
        return self.drape.positions(rest, self.start, self.proximal, tolerance, most)

    def value(self, x: Vector) -> float:
        """J [m^2]; infinite where nothing drapes."""
        rest = x.reshape(-1, 3)
        try:
            found = self.drape_of(rest)
        except InputError:
            return math.inf
        if not np.isfinite(found.positions).all():
            return math.inf
        self.last, self.rest = found, rest
        away, changed = found.positions - self.drape.target, rest - self.guess
        return 0.5 * float(np.sum(away**2)) + 0.5 * self.options.regularisation * float(np.sum(changed**2))

    def gradient(self) -> Vector:
        """dJ/dp (3 n,) where J was computed last."""
        away = self.last.positions - self.drape.target
        pulled = self.drape.pulled_back(self.rest, self.last, away, self.proximal)
        return np.asarray(pulled + self.options.regularisation * (self.rest - self.guess)).reshape(-1)
