"""The time loop of any scene: frame after frame into a store, with a checkpoint after each, resumable at any moment.

Nothing but the state is carried from one frame to the next, so a run resumed from a checkpoint repeats the
same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.results import Store, frame_tree, step_table
from barchan.scenes.model import Model, State, StepRecordLike
from barchan.scenes.progress import Progress


@dataclass
class Clock:
    """Wall-clock figures of a run, summed over its sessions (kept in checkpoints, never in results.h5).

    seconds : spent in the time loop. warm_seconds, warm_steps : spent in steps, the first of each session
    left out because it compiles or loads kernels.
    """

    seconds: float = 0.0
    warm_seconds: float = 0.0
    warm_steps: int = 0

    @property
    def seconds_per_step(self) -> float | None:
        """Mean of the warm steps; None before the second step."""
        return self.warm_seconds / self.warm_steps if self.warm_steps else None


def run_frames(
    model: Model[State], store: Store, frame_rate: float, frame_count: int, progress: Progress
) -> tuple[Clock, int]:
    """Advance `model` to frame `frame_count` (time frame_count / frame_rate), continuing from the store's checkpoint.

    Returns the wall-clock figures and the number of the last frame, less than `frame_count` when the model has
    ended before. Raises InputError when the checkpoint or a frame is damaged, or the store cannot be written.
    """
    state, frame, clock = _start(model, store)
    start, spent = perf_counter(), clock.seconds
    progress.resume(frame, state.time)
    warm = False
    while frame < frame_count and not model.ended(state):
        frame += 1
        records: list[StepRecordLike] = []
        until = frame / frame_rate
        while until - state.time > 1e-9 / frame_rate:
            began = perf_counter()
            state, record = model.advance(state, next_step(until - state.time, model.longest_step(state)))
            records.append(record)
            if warm:
                clock.warm_seconds += perf_counter() - began
                clock.warm_steps += 1
            warm = True
            progress.step(state.time, record.step, record.sweeps, record.residual)
        clock.seconds = spent + perf_counter() - start
        _keep(model, store, state, frame, records, clock)
    return clock, frame


def clock_of(checkpoint: Mapping[str, Any] | None) -> Clock:
    """The wall-clock figures in a checkpoint."""
    if checkpoint is None:
        return Clock()
    kept = checkpoint["clock"]
    return Clock(float(kept["seconds"]), float(kept["warm_seconds"]), int(kept["warm_steps"]))


def next_step(remaining: float, longest: float) -> float:
    """Length (s) of the next of the fewest equal steps that cover `remaining` s, none longer than `longest` s."""
    return remaining / max(1, math.ceil(remaining / longest * (1.0 - 1e-9)))


def _start(model: Model[State], store: Store) -> tuple[State, int, Clock]:
    """State, frame number and clock to go on from."""
    checkpoint = store.checkpoint()
    if checkpoint is None:
        state = model.initial()
        clock = Clock()
        _keep(model, store, state, 0, [], clock)
        return state, 0, clock
    frame = int(checkpoint["frame"])
    if store.frame_count() <= frame:
        raise InputError(
            store.frame_name(store.frame_count()),
            "missing",
            f"there, for the checkpoint stands at frame {frame}",
        )
    for index in range(frame + 1):
        store.frame_image(index)  # a damaged frame is better found now than after the rest of the run
    return model.restore(checkpoint["state"]), frame, clock_of(checkpoint)


def _keep(
    model: Model[State], store: Store, state: State, index: int, records: list[StepRecordLike], clock: Clock
) -> None:
    """Store a frame, then the checkpoint that makes it final."""
    observables = model.observables(state, records[-1] if records else None)
    store.put_frame(index, frame_tree(model.frame(state), step_table(records), observables))
    store.put_checkpoint({"frame": np.int64(index), "state": model.arrays(state), "clock": asdict(clock)})
