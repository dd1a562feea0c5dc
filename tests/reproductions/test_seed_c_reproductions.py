"""Seed C's tables: published numbers agree with each other, ours land in their cells, its failures are found again."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import reproductions
from barchan.flows.quasi_newtonian import Bingham, NonlinearOptions
from barchan.reproductions import (
    adaptive_newton,
    continuation,
    couette_levels,
    couette_lines,
    couette_regularisation,
    couette_solver,
    couette_strategies,
    cylinder_benchmark,
    flow_solves,
)
from barchan.reproductions.couette_strategies import loop_length, outcome
from barchan.reproductions.flow_solves import History, Wanted, agreement, run_solves, solve_all, steps_of
from barchan.reproductions.workshop import Finished, Job, Workshop, published

REFERENCES = (
    "adaptive_newton", "adaptive_newton_continuation", "couette", "couette_errors", "cylinder_benchmark",
)  # fmt: skip


def history(steps: int, converged: bool = True, last: float = 1e-9) -> History:
    return History(
        np.geomspace(1.0, last, steps + 1).tolist(), [0.5] * steps, [2] * steps, converged, 415, 1.0
    )


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


class TestPublished:
    @pytest.mark.parametrize("name", REFERENCES)
    def test_the_tables_are_those_of_the_reference(self, name: str, shared_data: Path) -> None:
        lines = (shared_data / "reference" / f"{name}.csv").read_text().splitlines()
        assert published(name) == list(csv.DictReader(line for line in lines if not line.startswith("#")))

    def test_tables_that_repeat_each_other_agree(self) -> None:
        pairs = {(row["level"], row["quantity"]): row for row in published("couette_level_pairs")}
        for row in published("couette_errors"):
            for quantity in ("u", "shear_rate", "viscosity"):
                assert pairs["7", quantity][f"l{row['level']}"] == row[quantity]
        started = {row["delta0"]: row for row in published("adaptive_start")}
        chains = {(row["continuation"], row["eps"]): row for row in published("adaptive_newton_continuation")}
        assert all(chains["eps", "1e-2"][tau] == started["0.0"][tau] for tau in continuation.TAUS)

    def test_xi_is_nearly_symmetric_where_lines_are_close(self) -> None:
        pairs = {(int(row["level"]), row["quantity"]): row for row in published("couette_level_pairs")}
        for (i, quantity), row in pairs.items():
            for j in range(5, 8):
                if i >= 5 and i != j:
                    assert float(row[f"l{j}"]) == pytest.approx(float(pairs[j, quantity][f"l{i}"]), rel=0.01)


class TestCounts:
    @pytest.mark.parametrize(("entry", "steps"), [("23", 23), ("170+2", 172), ("osci", None), ("", None)])
    def test_steps_of_an_entry(self, entry: str, steps: int | None) -> None:
        assert steps_of(entry) == steps

    def test_a_count_agrees_within_thirty_percent_or_below(self) -> None:
        pairs = [
            ("10", history(13)), ("10", history(14)), ("10", history(3)), ("10", history(9, converged=False)),
            ("osci", history(9)), ("osci", history(9, converged=False)), ("", history(5)),
        ]  # fmt: skip
        words = agreement(pairs)
        assert words.startswith("2 of 4")
        assert "1 of ours do not converge" in words
        assert "1 do where they do not" in words

    @pytest.mark.parametrize("period", [1, 3, 5])
    def test_a_loop_has_its_length(self, period: int) -> None:
        loop = (1.0 + np.arange(period)).tolist() * 12
        assert loop_length([50.0, 20.0, *loop]) == period
        drifting = (np.array(loop) * 0.999 ** np.arange(len(loop))).tolist()
        assert loop_length(drifting) is None


class TestSolves:
    FLUIDS = (Bingham(1.0, 0.5, 0.1), Bingham(1.0, 0.5, 0.1), Bingham(1.0, 1.0, 0.1))

    def test_a_solution_starts_the_next(self) -> None:
        wanted = Wanted("chain", "cylinder_dfg", 1, self.FLUIDS, NonlinearOptions())
        first, same, other = run_solves(wanted)
        assert first.converged
        assert same.iterations == 0
        assert 0 < other.iterations <= first.iterations
        (alone,) = run_solves(Wanted("alone", "cylinder_dfg", 1, self.FLUIDS[2:], NonlinearOptions()))
        assert other.residuals[0] != pytest.approx(alone.residuals[0])

    def test_what_is_kept_is_not_solved_again(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        wanted = Wanted("one", "cylinder_dfg", 1, self.FLUIDS[:1], NonlinearOptions())
        workshop = Workshop(tmp_path)
        first = solve_all(workshop, [wanted])

        def forbidden(*_: object) -> None:
            raise AssertionError("a finished solve was done again")

        monkeypatch.setattr(flow_solves, "run_solves", forbidden)
        assert solve_all(workshop, [wanted]) == first

    def test_every_option_has_its_own_file(self) -> None:
        base: dict[str, Any] = {"label": "a", "scene": "couette", "level": 1, "fluids": self.FLUIDS[:1]}
        files = {
            Wanted(options=options, **{**base, **other}).file
            for options in (
                NonlinearOptions(),
                NonlinearOptions(delta0=0.3),
                NonlinearOptions(tolerance=1e-7),
            )
            for other in ({}, {"level": 2}, {"fluids": self.FLUIDS[2:]}, {"nested": True}, {"gain": 0.2})
        }
        assert len(files) == 15


def number_of(wanted: Wanted, fluid: Any) -> int:
    """A number of steps that tells yield stress, eps and level."""
    return round(1e4 * fluid.yield_point) + round(1e6 * fluid.eps) + wanted.level


class TestTables:
    @pytest.fixture
    def counted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def told(_: Workshop, wanted: list[Wanted], **__: Any) -> list[list[History]]:
            return [[history(number_of(item, fluid)) for fluid in item.fluids] for item in wanted]

        monkeypatch.setattr(continuation, "solve_all", told)

    @pytest.mark.usefixtures("counted")
    @pytest.mark.parametrize("quick", [True, False])
    def test_counts_of_continuation_stand_beside_their_yield_stress(
        self, tmp_path: Path, quick: bool
    ) -> None:
        report = reproductions.reproduce("continuation", tmp_path, quick=quick)
        rows = rows_of(tmp_path / "counts.csv")
        for row in rows:
            eps = row["row"].split("eps ")[1] if row["table"].startswith("13") else "1e-2"
            # Tables "itself" add eps to |g|^2, so that the fluid has its root.
            added = float(eps) ** (0.5 if row["table"].endswith("itself") else 1.0)
            expected = round(1e4 * float(row["tau0"])) + round(1e6 * added) + int(row["level"])
            assert int(row["ours"]) == expected, row
        if not quick:
            assert {table: sum(row["table"] == table for row in rows) for table in ("10", "11", "12 whole", "13 halved")} == {
                "10": 24, "11": 24, "12 whole": 28, "13 halved": 56,
            }  # fmt: skip
        ten = report.tables[0]
        assert list(ten.rows[0][:3]) == ["fixed point, level 2", "21", "10003"]

    def test_counts_of_the_adaptive_method_stand_beside_theirs(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def told(_: Workshop, wanted: list[Wanted]) -> list[list[History]]:
            return [[history(round(1e3 * item.fluids[0].yield_point))] for item in wanted]

        monkeypatch.setattr(adaptive_newton, "solve_all", told)
        report = reproductions.reproduce("adaptive_newton", tmp_path)
        rows = rows_of(tmp_path / "counts.csv")
        assert len(rows) == 5 * (6 + 6 + 6 + 10 + 10 + 10)
        assert all(int(row["ours"]) == round(1e3 * float(row["tau0"])) for row in rows)
        assert list(report.tables[0].rows[4][-2:]) == ["170+2", "1000+0"]  # no step had the whole weight
        assert {"phases.png", "residuals.png", "histories.csv", "counts.csv"} <= {
            p.name for p in tmp_path.iterdir()
        }

    def test_the_cost_of_a_solve_stands_in_its_cell(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def told(_: Workshop, wanted: list[Wanted], **__: Any) -> list[list[History]]:
            return [[history(10 * item.level + round(-np.log10(item.fluids[0].eps)))] for item in wanted]

        monkeypatch.setattr(couette_solver, "solve_all", told)
        monkeypatch.setattr(couette_solver, "run_solves", lambda _: [])
        report = reproductions.reproduce("couette_solver", tmp_path)
        cost = report.tables[0]
        assert cost.rows[0][3:] == [
            "20, 1 s", "22/2, 1 s", "22/2, 1 s",
            "21/1, 1.5 s", "22/2, 1 s", "22/2, 1 s",
            "37/1, 2.85 s", "23/2, 1 s", "23/2, 1 s",
        ]  # fmt: skip
        assert [row[0] for row in cost.rows] == ["2", "3", "4", "5", "6", "7"]
        assert [len(table.rows) for table in report.tables[1:]] == [6, 5, 5, 5]

    def test_drag_and_lift_stand_beside_the_reference(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def told(_: Workshop, jobs: list[Job]) -> list[Finished]:
            return [
                Finished(
                    {
                        "drag": 1000.0 * job.overrides["level"], "lift": 2.0, "unknowns": 7, "converged": True,
                        "nonlinear_iterations": {"newton": 4.0, "fixed-point": 9.0}.get(job.overrides["method"], 3.0),
                        "worst_certificate": 1e-9,
                    },
                    {"residuals": 0.1 ** (2.0 ** np.arange(4))},
                    None,  # type: ignore[arg-type]
                )
                for job in jobs
            ]  # fmt: skip

        monkeypatch.setattr(Workshop, "run", told)
        monkeypatch.setattr(
            cylinder_benchmark, "solve_all", lambda _, wanted: [[history(14)] for _ in wanted]
        )
        report = reproductions.reproduce("cylinder_benchmark", tmp_path)
        bingham = report.tables[3]
        assert bingham.rows[0][2:6] == ["3492.406", "3000", "-14.099 %", "-14.284 %"]
        assert bingham.rows[0][-5:] == ["17", "9", "4", "4", "3"]
        assert report.tables[2].rows[2][-5:] == ["12", "9", "3", "4", "14"]
        assert "bingham 2.0" in report.notes[1]  # residuals 1e-1, 1e-2, 1e-4, 1e-8


class TestCouette:
    def test_the_published_failures_are_found_again(self) -> None:
        (stuck,) = run_solves(couette_strategies._wanted("f1", 2, "1e-3", 60))
        assert outcome(stuck).startswith("stagnates")
        (loop,) = run_solves(couette_strategies._wanted("f2", 3, "1e-2", 80))
        assert outcome(loop) == "loop of 3 steps"
        (ours,) = run_solves(couette_strategies._wanted("stress-velocity", 2, "1e-3", 60))
        assert ours.converged
        assert ours.iterations <= 15

    def test_lines_approach_the_exact_ones(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(couette_levels, "QUICK_LEVELS", (1, 2, 3))
        pairs = published("couette_level_pairs")
        pairs += [
            dict.fromkeys(pairs[0], "") | {"level": "1", "quantity": q} for q in couette_lines.QUANTITIES
        ]
        pairs = [{"l1": "", **row} for row in pairs]
        monkeypatch.setattr(couette_levels, "published", lambda n: pairs if "pairs" in n else published(n))
        report = reproductions.reproduce("couette_levels", tmp_path, quick=True, processes=1)
        assert report.converged
        found = {
            (row["level"], row["quantity"]): float(row["xi"]) for row in rows_of(tmp_path / "errors.csv")
        }
        for quantity in couette_lines.QUANTITIES:
            assert found["3", quantity] < found["2", quantity] < found["1", quantity]
        assert (tmp_path / "lines.png").exists()

    def test_the_regularisation_matters_less_as_it_falls(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(couette_regularisation, "QUICK_LEVELS", (2, 3))
        monkeypatch.setattr(couette_regularisation, "EXPONENTS", (1, 2, 3))
        report = reproductions.reproduce("couette_regularisation", tmp_path, quick=True, processes=1)
        assert report.converged
        entries = {row[0]: [float(cell) for cell in row[2::2]] for row in report.tables[0].rows}
        for quantity in ("u", "shear_rate"):
            assert np.all(
                np.array(entries[f"xi_32, {quantity}"]) < 0.5 * np.array(entries[f"xi_21, {quantity}"])
            )
        assert entries["xi_21, u"][1] == pytest.approx(6.17, rel=0.1)  # published, level 3
