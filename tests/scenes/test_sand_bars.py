"""What the scenes of sand must show at the end of a whole run (seed B 7.5); long."""

from __future__ import annotations

import pytest

from barchan import scenes


@pytest.mark.slow
def test_the_heap_of_a_round_column_is_round_within_two_percent() -> None:
    run = scenes.load("cylinder_collapse").run(progress=False)
    assert run.summary["converged"]
    assert run.summary["outline_circularity"] <= 1.02
    assert run.summary["outline_fourfold"] <= 0.01
    assert run.summary["largest_energy_rise"] <= 1e-9
    assert run.summary["volume_left"] == pytest.approx(1.0, rel=1e-12)
