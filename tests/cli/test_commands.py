"""The commands as a person meets them: what they print, what they leave, and their exit codes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from barchan import cli, results, scenes

SmallRun = Callable[..., list[str]]


class TestRun:
    def test_a_run_leaves_a_complete_folder_and_a_second_one_gets_the_next_number(
        self, small_run: SmallRun, capsys: pytest.CaptureFixture[str]
    ) -> None:
        arguments = small_run("time.end=0.04", "tolerance=1e-3")
        assert cli.main(arguments) == 0
        folder = Path("runs/collapse-1")
        names = sorted(path.name for path in folder.iterdir())
        assert names == ["pictures", "results.h5", "results.xdmf", "scene.toml", "summary.json"]
        pictures = sorted(path.name for path in (folder / "pictures").iterdir())
        assert pictures == ["collapse.gif", "observables.png", "profile.png", "strip.png"]
        assert json.loads((folder / "summary.json").read_text())["converged"]
        shown = capsys.readouterr()
        assert "run-out" in shown.out
        assert "runs/collapse-1" in shown.out
        assert "100 %" in shown.err
        assert cli.main([*arguments, "--quiet", "--set", "time.end=0.02"]) == 0
        assert results.open("runs/collapse-2").frames == 2
        assert capsys.readouterr() == ("", "")

    def test_resuming_a_finished_run_says_so(
        self, small_run: SmallRun, capsys: pytest.CaptureFixture[str]
    ) -> None:
        arguments = [*small_run("time.end=0.02", "tolerance=1e-3"), "--out", "x"]
        assert cli.main([*arguments, "--quiet"]) == 0
        before = Path("x/results.h5").read_bytes()
        assert cli.main([*arguments, "--resume"]) == 0
        assert "already finished" in capsys.readouterr().out
        assert Path("x/results.h5").read_bytes() == before

    def test_steps_that_miss_the_tolerance_give_exit_code_3(
        self, small_run: SmallRun, capsys: pytest.CaptureFixture[str]
    ) -> None:
        hard = small_run("time.end=0.04", "max_sweeps=1", "min_sweeps=0", "tolerance=1e-9")
        assert cli.main([*hard, "--quiet", "--out", "x"]) == 3
        assert "missed the tolerance" in capsys.readouterr().err
        assert results.open("x").summary["unconverged_steps"] > 0

    def test_an_interrupted_run_says_how_to_go_on(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def interrupt(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(scenes.Scene, "run", interrupt)
        assert cli.main(["run", "collapse", "--out", "a run"]) == 130
        assert "barchan run 'a run/scene.toml' --out 'a run' --resume" in capsys.readouterr().err


class TestOtherCommands:
    def test_the_scenes_are_listed(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["scenes"]) == 0
        shown = capsys.readouterr().out
        assert all(name in shown for name in scenes.preset_names())

    def test_without_a_command_there_is_help(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main([]) == 0
        assert "Usage" in capsys.readouterr().out

    def test_help_needs_no_heavy_import(self, python_environment: dict[str, str]) -> None:
        heavy = "matplotlib numba scipy h5py pydantic"
        code = f"import sys, barchan.cli; sys.exit(sum(name in sys.modules for name in {heavy.split()!r}))"
        assert subprocess.run([sys.executable, "-c", code], env=python_environment).returncode == 0


class TestSolve:
    def test_a_solved_problem_shows_its_certificate(
        self, problem_file: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["solve", problem_file, "--tol", "1e-8"]) == 0
        shown = capsys.readouterr().out
        for word in ("blocks n", "block size s", "certificate", "law", "balance", "bilateral", "converged"):
            assert word in shown

    def test_an_unreached_tolerance_gives_exit_code_3(
        self, problem_file: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["solve", problem_file, "--tol", "1e-300", "--method", "aspg"]) == 3
        assert "misses the tolerance" in capsys.readouterr().err


def test_a_real_run_killed_with_sigkill_and_resumed_has_the_bytes_of_an_uninterrupted_one(
    small_run: SmallRun, python_environment: dict[str, str]
) -> None:
    command = [sys.executable, "-m", "barchan.cli", *small_run("time.end=0.6"), "--quiet"]
    assert subprocess.run([*command, "--out", "whole"], env=python_environment).returncode in (0, 3)
    process = subprocess.Popen([*command, "--out", "killed"], env=python_environment)
    while process.poll() is None and not Path("killed/frames/frame_00004.h5").exists():
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert results.open("killed").frames >= 5
    assert subprocess.run([*command, "--out", "killed", "--resume"], env=python_environment).returncode in (
        0,
        3,
    )
    assert Path("killed/results.h5").read_bytes() == Path("whole/results.h5").read_bytes()
    with h5py.File("whole/results.h5") as file:
        assert len(file["frames"]) == 31
