"""How a body moves: free under forces, fixed, or as prescribed by key frames (seed B, 7.4.1: infinite inertia)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs, rotations
from barchan.errors import InputError

Load = ArrayLike | Callable[[float], ArrayLike]
_TRANSLATIONS = {2: {"x": 0, "y": 1, "z": 1}, 3: {"x": 0, "y": 1, "z": 2}}
_SPINS = {2: {"spin": 0, "spin_y": 0}, 3: {"spin_x": 0, "spin_y": 1, "spin_z": 2}}


@dataclass(frozen=True, eq=False)
class Free:
    """Moved by gravity, loads and what it touches.

    force : (d,) [N], or a function of the time [s] that gives it; added to `Body.force`.
    torque : (3,) in space, one number in the plane [N m], or a function of the time; added to `Body.torque`.
    held : components that keep the value zero: "x", "y", "z", "spin_x", "spin_y", "spin_z" in space; "x", "z", "spin" in
        the plane. World axes; each holds with an infinite mass.
    """

    force: Load | None = None
    torque: Load | None = None
    held: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        known = {*_TRANSLATIONS[3], *_SPINS[3], *_SPINS[2]}
        names = (self.held,) if isinstance(self.held, str) else tuple(self.held)
        for name in names:
            if name not in known:
                raise InputError("motion.held", name, f"one of {', '.join(sorted(known))}")
        object.__setattr__(self, "held", names)


@dataclass(frozen=True)
class Fixed:
    """At rest for ever: a frictional wall."""


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Moved through key frames, linearly in between, at rest before the first and after the last.

    times : (m,) increasing [s].
    positions : (m, d) [m] of the origin of the shape.
    rotations : (m,) angles in the plane, of any size; (m, 4) unit quaternions in space, less than half a turn from one to
        the next; None keeps the rotation of the body.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64] | None = field(default=None)

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=np.float64))
        if times.ndim != 1 or len(times) == 0 or not np.all(np.isfinite(times)):
            raise InputError("motion.times", self.times, "finite numbers, one at least")
        if np.any(np.diff(times) <= 0.0):
            raise InputError("motion.times", times.tolist(), "increasing")
        positions = inputs.table("motion.positions", self.positions, (2, 3), 1)
        if len(positions) != len(times):
            raise InputError("motion.positions", positions.shape, f"a row for each of the {len(times)} times")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)
        if self.rotations is not None:
            d = positions.shape[1]
            given: Sequence[ArrayLike] = list(np.asarray(self.rotations, dtype=np.float64))
            if len(given) != len(times):
                raise InputError("motion.rotations", len(given), f"a row for each of the {len(times)} times")
            rows = [rotations.as_rotation("motion.rotations", row, d) for row in given]
            object.__setattr__(self, "rotations", np.array(rows))

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.positions.shape[1])

    def position_at(self, time: float) -> NDArray[np.float64]:
        """Position (d,) [m] at `time`."""
        return np.array([np.interp(time, self.times, column) for column in self.positions.T])

    def rotation_at(self, time: float) -> NDArray[np.float64] | None:
        """Rotation at `time`, turning at constant spin between key frames; None when not prescribed."""
        if self.rotations is None:
            return None
        if time <= self.times[0] or len(self.times) == 1:
            return self.rotations[0].copy()
        if time >= self.times[-1]:
            return self.rotations[-1].copy()
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        share = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        before = self.rotations[k]
        turn = rotations.logarithm(rotations.product(self.rotations[k + 1], rotations.inverse(before)))
        return rotations.turned(before, turn, float(share))


Motion = Free | Fixed | Prescribed


def held_components(motion: Motion, dimension: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of the d translations, and of the spins (3 in space, 1 in the plane), a motion holds at zero."""
    moves = np.zeros(dimension, dtype=np.bool_)
    spins = np.zeros(3 if dimension == 3 else 1, dtype=np.bool_)
    if isinstance(motion, Free):
        for name in motion.held:
            if name in _TRANSLATIONS[dimension]:
                moves[_TRANSLATIONS[dimension][name]] = True
            elif name in _SPINS[dimension]:
                spins[_SPINS[dimension][name]] = True
            else:
                allowed = [*_TRANSLATIONS[dimension], *_SPINS[dimension]]
                raise InputError("motion.held", name, f"one of {', '.join(allowed)} in {dimension}D")
    return moves, spins


def load_at(field_name: str, load: Load | None, time: float, size: int) -> NDArray[np.float64]:
    """Load (size,) at `time`; zero when there is none."""
    if load is None:
        return np.zeros(size)
    value = load(time) if callable(load) else load
    return inputs.vector(field_name, np.atleast_1d(np.asarray(value, dtype=np.float64)), (size,))
