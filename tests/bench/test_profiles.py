"""Performance profiles and ratios keep their definitions (Dolan and More 2002), on costs made up by hand."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest

from barchan.bench.measurement import LATE, Measurement
from barchan.bench.profile import as_csv, as_markdown, cost_table, performance_profile, ratio_to_best

COSTS = np.array([[1.0, 2.0, np.inf], [4.0, 1.0, 1.0], [np.inf, np.inf, 3.0], [np.inf, np.inf, np.inf]])


def share_at(x: float) -> np.ndarray:
    grid, share = performance_profile(COSTS)
    return share[np.searchsorted(grid, x, side="right") - 1]


def test_a_profile_starts_with_the_shares_of_fastest_and_ends_with_the_shares_solved() -> None:
    assert share_at(1.0) == pytest.approx([1 / 4, 1 / 4, 2 / 4])
    assert share_at(1.99) == pytest.approx([1 / 4, 1 / 4, 2 / 4])
    assert share_at(2.0) == pytest.approx([1 / 4, 2 / 4, 2 / 4])
    assert share_at(4.0) == pytest.approx([2 / 4, 2 / 4, 2 / 4])
    assert share_at(1e9) == pytest.approx(np.isfinite(COSTS).mean(axis=0))


def test_profiles_grow_and_do_not_depend_on_the_unit_of_time() -> None:
    rng = np.random.default_rng(0)
    costs = np.where(rng.random((40, 5)) < 0.3, np.inf, 10.0 ** rng.uniform(-3, 3, (40, 5)))
    x, share = performance_profile(costs)
    assert x[0] == 1.0 and (np.diff(x) > 0.0).all() and (np.diff(share, axis=0) >= 0.0).all()
    again, same = performance_profile(1024.0 * costs)
    assert np.array_equal(x, again) and np.array_equal(share, same)


def test_nobody_solves_anything() -> None:
    x, share = performance_profile(np.full((3, 2), np.inf))
    assert x.tolist() == [1.0] and not share.any()


def test_the_ratio_is_a_geometric_mean_over_what_both_solve() -> None:
    ratio, count = ratio_to_best(COSTS, 0, [1, 2])
    assert (ratio, count) == (pytest.approx(math.sqrt(2.0 / 1.0 * 1.0 / 4.0)), 2)
    assert math.isnan(ratio_to_best(COSTS, 0, [])[0])


def test_tables_tell_success_from_failure() -> None:
    made = [
        Measurement("one", "fast", 1e-7, 12, 0.002, True),
        Measurement("one", "slow", 1e-3, 99, 0.5, False, note="tolerance not reached"),
        Measurement("two", "fast", 1e-7, 12, 11.0, False, note=LATE),
        Measurement("two", "slow", note="not for this problem: law must be associated, in one | piece"),
    ]
    problems, solvers, costs = cost_table(made)
    assert (problems, solvers) == (["one", "two"], ["fast", "slow"])
    assert costs.tolist() == [[0.002, math.inf], [math.inf, math.inf]]
    rows = list(csv.DictReader(io.StringIO(as_csv(made))))
    assert [row["converged"] for row in rows] == ["True", "False", "False", "False"]
    assert float(rows[0]["milliseconds"]) == pytest.approx(2.0)
    text = as_markdown(made, ["slow"], "heading")
    assert "| 2 ms, 12 " in text and "no: 1.0e-03" in text and "late: 1.0e-07" in text
    assert "| fast   | 1 of 2 |" in text
