"""When a method over equilibrated forces looks at its residual, records and stops; one rhythm for all of them."""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._scaled import ScaledProblem
from barchan.friction.methods._shift import LaggedShift
from barchan.friction.solution import Recorder


class Rhythm:
    """Records every `check_every` iterations and at `limit`, the last one; tells a lagging `shift` what it saw."""

    def __init__(
        self,
        scaled: ScaledProblem,
        recorder: Recorder,
        check_every: int,
        limit: int,
        shift: LaggedShift | None = None,
    ) -> None:
        self.scaled, self.recorder = scaled, recorder
        self.check_every, self.limit = check_every, limit
        self.shift = shift

    def ends(self, iteration: int, x: np.ndarray, u: np.ndarray) -> bool:
        """Whether the method is over at scaled forces x and their scaled rates u, both (n, s)."""
        last = iteration == self.limit
        if iteration % self.check_every and not last:
            return False
        residual = self.scaled.residual_at(x, u)
        if self.recorder.record(iteration, residual, self.scaled.root * x) or last:
            return True
        if self.shift is not None:
            self.shift.watch(iteration, residual)
        return False
