"""What the runner needs from a flow: state in, state out, and how to look at a state. One class per kind of scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


class TimedState(Protocol):
    """A state of a simulation, at a time (s, or the scene's own unit)."""

    @property
    def time(self) -> float:
        """Time (s)."""


class StepRecordLike(Protocol):
    """A frozen dataclass of numbers about one step; the progress display shows these three."""

    @property
    def step(self) -> int:
        """Number of the step, from 1."""

    @property
    def sweeps(self) -> int:
        """Iterations of the friction solver."""

    @property
    def residual(self) -> float:
        """Certificate of the step."""


State = TypeVar("State", bound=TimedState)


class Model(Protocol[State]):
    """A deterministic simulation whose whole memory is its state."""

    def initial(self) -> State:
        """The state at time 0."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> State:
        """The state written by `arrays`, bit for bit."""

    def arrays(self, state: State) -> Arrays:
        """Everything the next step depends on."""

    def longest_step(self, state: State) -> float:
        """Longest time step (s) to take from this state."""

    def advance(self, state: State, dt: float) -> tuple[State, StepRecordLike]:
        """One step of `dt` seconds."""

    def ended(self, state: State) -> bool:
        """Whether nothing would be learnt from running on after a frame with this state; a function of the state only."""

    def frame(self, state: State) -> dict[str, Arrays]:
        """The groups of arrays that are stored for a frame, see `barchan.results.frame_tree`."""

    def observables(self, state: State, record: Any) -> dict[str, float]:
        """Scalars of a frame; `record` is that of the last step, None at the start."""


@runtime_checkable
class WritesFiles(Protocol):
    """A model that writes files of its own while it runs. folder : the run folder, None while nothing is stored."""

    folder: Path | None
