"""`barchan bench solvers` and `barchan solve --existence` as a person meets them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from barchan import cli, friction
from barchan.friction.samples import family

Complaint = Callable[..., str]
QUICK = ("--methods", "aspg", "--repeats", "1", "--no-peers")


@pytest.fixture
def folder(problem_file: str) -> str:
    """A folder with two problems."""
    place = Path("problems")
    place.mkdir()
    for name in ("one.hdf5", "two.hdf5"):
        shutil.copy(problem_file, place / name)
    return str(place)


class TestBench:
    def test_a_comparison_says_where_its_files_are(
        self, folder: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["bench", "solvers", folder, *QUICK]) == 0
        out = Path("runs/bench-solvers-1")
        printed = capsys.readouterr()
        assert str(out) in printed.out and "2 of 2" in printed.out
        assert "one.hdf5  aspg" in printed.err
        names = {"results.csv", "results.md", "profile.png", "residuals.png"}
        assert {path.name for path in out.iterdir()} == names
        assert (out / "results.csv").read_text().count("\n") == 3
        assert cli.main(["bench", "solvers", folder, *QUICK]) == 0
        assert Path("runs/bench-solvers-2").is_dir()

    def test_convex_methods_compete_on_the_convexified_problems(self, folder: str) -> None:
        methods = ("--methods", "clarabel_dual,clarabel_primal,aspg", "--repeats", "1")
        assert cli.main(["bench", "solvers", folder, *methods, "--convexified", "--out", "x"]) == 0
        rows = Path("x/results.csv").read_text().splitlines()[1:]
        assert len(rows) == 6 and all(",True," in row for row in rows)

    def test_no_folder_takes_a_made_family(self) -> None:
        command = ["bench", "solvers", "--family", "unsolvable", *QUICK, "--time-limit", "0.05", "--out", "x"]
        assert cli.main(command) == 0
        assert Path("x/results.csv").read_text().count("unsolvable,aspg,False") == len(family("unsolvable"))

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["--methods", "auto,magic"], "methods = magic: must be one of auto, gauss_seidel"),
            (["--methods", ","], "methods = none"),
            (["--tol", "-1"], "tolerance = -1"),
            (["--time-limit", "nan"], "time_limit = nan"),
            (["--repeats", "0"], "repeats = 0"),
            (["--out", "problems/one.hdf5"], "problems/one.hdf5 = a file: must be a folder"),
            (["--frobnicate"], "--frobnicate"),
        ],
    )
    def test_bad_options_are_one_line(
        self, folder: str, complaint: Complaint, arguments: list[str], message: str
    ) -> None:
        assert message in complaint("bench", "solvers", folder, *QUICK, *arguments)
        assert not Path("runs").exists()

    def test_bad_folders_are_one_line(self, folder: str, complaint: Complaint) -> None:
        assert "nowhere = no such folder" in complaint("bench", "solvers", "nowhere", *QUICK)
        Path("empty").mkdir()
        assert "empty = no problem file" in complaint("bench", "solvers", "empty", *QUICK)
        (Path(folder) / "three.dat").write_text("no problem here")
        assert "three.dat" in complaint("bench", "solvers", folder, *QUICK)
        assert "family = huge" in complaint("bench", "solvers", "--family", "huge", *QUICK)
        assert not Path("runs").exists()

    def test_bench_needs_a_name(self, complaint: Complaint) -> None:
        assert "fly" in complaint("bench", "fly")


class TestExistence:
    def test_no_solution_is_said_apart_from_not_converged(self, capsys: pytest.CaptureFixture[str]) -> None:
        friction.write("none.hdf5", family("unsolvable")[4][1])
        assert cli.main(["solve", "none.hdf5", "--existence"]) == 3
        printed = capsys.readouterr()
        assert printed.err.startswith("barchan: no solution exists: ") and printed.err.count("\n") == 1
        assert "existence" in printed.out

    def test_a_solution_that_exists_is_announced(
        self, problem_file: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["solve", problem_file, "--existence"]) == 0
        assert "a solution exists" in capsys.readouterr().out

    def test_a_tolerance_out_of_reach_is_not_converged(
        self, problem_file: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["solve", problem_file, "--tol", "1e-300", "--existence"]) == 3
        assert capsys.readouterr().err.startswith("barchan: not converged: ")
