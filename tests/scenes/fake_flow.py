"""A fast deterministic double of a flow, for tests of storage and resuming: particles jump by a logistic map.

The map is chaotic: a run that resumes from anything but the exact bits of its state ends elsewhere.
"""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barchan import scenes, storage
from barchan.scenes import finish
from barchan.scenes.kinds.column import observables

TINY = {
    "scene.name": "tiny",
    "box.size": [1.0, 0.5],
    "box.cells": [10, 5],
    "column.length": 0.3,
    "column.height": 0.4,
    "time.end": 0.3,
    "time.frame_rate": 10.0,
    "time.step": 0.04,
}


@dataclass(frozen=True)
class FakeState:
    time: float
    step: int
    positions: np.ndarray


@dataclass(frozen=True)
class FakeRecord:
    step: int
    time: float
    dt: float
    sweeps: int
    residual: float
    converged: bool
    kinetic_energy: float
    potential_energy: float
    max_speed: float
    max_volume_fraction: float
    total_volume: float


class FakeModel:
    """The logistic map x -> 3.9 x (1 - x) on box coordinates, one iteration a step."""

    def __init__(self, parameters, steps_before_interrupt=None):
        self.parameters = parameters
        self.box = np.array(parameters.box.size)
        self.count = 40
        self.steps_left = steps_before_interrupt

    def initial(self):
        rng = np.random.default_rng(7)
        return FakeState(0.0, 0, rng.uniform(0.1, 0.9, (self.count, len(self.box))) * self.box)

    def restore(self, arrays):
        return FakeState(float(arrays["time"]), int(arrays["step"]), arrays["positions"])

    def arrays(self, state):
        return {"time": np.float64(state.time), "step": np.int64(state.step), "positions": state.positions}

    def longest_step(self, state):
        return self.parameters.time.step

    def advance(self, state, dt):
        if self.steps_left is not None:
            if self.steps_left == 0:
                raise KeyboardInterrupt
            self.steps_left -= 1
        share = state.positions / self.box
        after = FakeState(state.time + dt, state.step + 1, 3.9 * share * (1.0 - share) * self.box)
        energy = float(after.positions[:, -1].sum())
        record = FakeRecord(
            after.step,
            after.time,
            dt,
            3,
            1e-5,
            True,
            0.5 * energy,
            energy,
            energy,
            1.0,
            self._volumes().sum(),
        )
        return after, record

    def _volumes(self):
        return np.full(self.count, observables.column_volume(self.parameters) / self.count)

    def ended(self, state):
        return False

    def frame(self, state):
        return {"particles": self.particles(state), "grid": self.grid(state)}

    def particles(self, state):
        return {"positions": state.positions, "velocities": -state.positions, "volumes": self._volumes()}

    def grid(self, state):
        d = len(self.box)
        corners = np.array(np.meshgrid(*[[0.0, 0.1]] * d, indexing="ij")).reshape(d, -1).T
        order = [0, 2, 3, 1] if d == 2 else [0, 4, 6, 2, 1, 5, 7, 3]
        return {
            "node_ids": np.arange(2**d),
            "positions": corners,
            "cells": np.array([order], dtype=np.int32),
            "velocities": np.full((2**d, d), state.time),
            "stresses": np.full((2**d, 3 * d - 3), state.time),
            "pressures": np.full(2**d, state.time),
            "volume_fractions": np.ones(2**d),
        }

    def observables(self, state, record):
        volumes = self._volumes()
        values = observables.geometry_observables(self.parameters, state.positions, volumes)
        energy = float(state.positions[:, -1].sum())
        return {
            "time": state.time,
            **values,
            "kinetic_energy": 0.0,
            "potential_energy": energy,
            "volume": volumes.sum(),
        }


class FakeScene(scenes.Scene):
    """A scene whose flow is the double; optionally interrupted by the user after some steps."""

    steps_before_interrupt = None

    def model(self):
        return FakeModel(self.parameters, self.steps_before_interrupt)


def fake_scene(**overrides):
    return FakeScene(scenes.load("collapse", **{**TINY, **overrides}).parameters)


def _run_and_die(folder, moment):
    """In a child process: run or resume, killed at the given file replacement, before or after it."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    replace, count = os.replace, 0

    def deadly_replace(source, target):
        nonlocal count
        if count == moment // 2:
            if moment % 2:
                replace(source, target)
            os.kill(os.getpid(), signal.SIGKILL)
        count += 1
        replace(source, target)

    if moment is not None:
        storage.os.replace = deadly_replace
    fake_scene().run(folder, resume=True, progress=False)
    os._exit(0)


def main(base):
    """Kill a run at every file replacement, resume it, and report where the bytes differ. Prints a report."""
    finish.draw_pictures = lambda *_: None
    reference = fake_scene().run(base / "reference", progress=False).folder
    wanted = (reference / "results.h5").read_bytes()
    deaths = 0
    while True:
        folder = base / f"death-{deaths}"
        code = _run_and_die(folder, deaths)
        if code == 0:
            break
        assert code == -signal.SIGKILL, code
        assert _run_and_die(folder, None) == 0, f"not resumable after death {deaths}"
        same = (folder / "results.h5").read_bytes() == wanted
        left = sorted(path.name for path in folder.iterdir())
        sys.stdout.write(f"{deaths} {same} {' '.join(left)}\n")
        deaths += 1


if __name__ == "__main__":
    main(Path(sys.argv[1]))
