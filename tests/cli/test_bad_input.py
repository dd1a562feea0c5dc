"""Every mistake on the command line is one clear line and exit code 2, with nothing written and nothing damaged."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from barchan import cli, scenes
from barchan.scenes import finish
from barchan.scenes.kinds.column import model as column

Complaint = Callable[..., str]
SmallRun = Callable[..., list[str]]


def contents(folder: str = ".") -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["colapse"], "nearest: collapse"),
        (["collapse", "--set", "material.frction=0.5"], "nearest: material.friction"),
        (["collapse", "--set", "materal.friction=0.5"], "nearest: material.friction"),
        (["collapse", "--set", "friction=-1"], "material.friction = -1: must be a finite number >= 0"),
        (["collapse", "--set", "friction=nan"], "material.friction = nan"),
        (["collapse", "--set", "density=inf"], "material.density = inf"),
        (["collapse", "--set", "viscosity=-0.1"], "material.viscosity = -0.1"),
        (["collapse", "--set", "time.end=nan"], "time.end = nan"),
        (["collapse", "--set", "walls.z_min={friction = -0.2}"], "walls.z_min"),
        (["collapse", "--set", "box.cells=[0, 30]"], "box.cells[0] = 0"),
        (["collapse", "--set", "box.cells=[100000, 100000]"], "grid.cells"),
        (["collapse", "--set", "box.size=[0.8, 0.0]"], "box.size[1] = 0.0"),
        (
            ["collapse", "--set", "size=[0.8, 0.2]", "--set", "column.length=2"],
            "column.length = 2.0: must be at most 0.8 m",
        ),
        (
            ["collapse", "--set", "size=[0.8, 0.2]", "--set", "column.height=2"],
            "column.height = 2.0: must be at most 0.2 m",
        ),
        (["collapse", "--set", "friction"], "key=value"),
        (["collapse", "--set", "solver.method=magic"], "solver.method = magic: must be one of auto"),
        (["collapse", "--resume"], "--out = missing"),
        (["collapse", "--frobnicate"], "--frobnicate"),
        (["."], "not readable"),
        ([], "scene"),
    ],
)
def test_bad_scenes_are_one_line_and_leave_nothing(
    arguments: list[str], message: str, complaint: Complaint
) -> None:
    assert message in complaint("run", *arguments)
    assert list(Path().iterdir()) == []


def test_a_scene_file_with_a_mistake_is_one_line(complaint: Complaint) -> None:
    text = scenes.load("collapse").toml()
    Path("odd.toml").write_text(text.replace("[material]", "[material]\nfrction = 0.5"))
    assert "material.frction = 0.5" in complaint("run", "odd.toml")
    Path("broken.toml").write_text("[scene\n")
    assert "broken.toml = not TOML" in complaint("run", "broken.toml")
    assert sorted(path.name for path in Path().iterdir()) == ["broken.toml", "odd.toml"]


def test_folders_that_cannot_be_used_are_left_as_they_are(complaint: Complaint) -> None:
    Path("foreign").mkdir()
    Path("foreign/thesis.tex").write_text("years of work")
    before = contents()
    for more in ([], ["--resume"]):
        assert "nothing was touched" in complaint("run", "collapse", "--out", "foreign", *more)
    assert "not writable" in complaint("run", "collapse", "--out", "foreign/thesis.tex/run")
    assert "must be a folder" in complaint("run", "collapse", "--out", "foreign/thesis.tex")
    assert contents() == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc refuses everybody on Linux only")
def test_a_folder_the_system_refuses_is_one_line(complaint: Complaint) -> None:
    assert "/proc/barchan = not writable" in complaint("run", "collapse", "--out", "/proc/barchan")


@pytest.fixture
def interrupted(small_run: SmallRun, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Arguments that resume a run in the folder x, interrupted in its fourth step."""
    arguments = [*small_run("time.end=0.08", "tolerance=1e-3"), "--quiet", "--out", "x"]
    advance = column.ColumnModel.advance

    def advance_three(self: column.ColumnModel, state: column.State, dt: float) -> object:
        if state.step == 3:
            raise KeyboardInterrupt
        return advance(self, state, dt)

    with monkeypatch.context() as patch:
        patch.setattr(column.ColumnModel, "advance", advance_three)
        assert cli.main(arguments) == 130
    return [*arguments, "--resume"]


@pytest.mark.parametrize("name", ["checkpoint.h5", "frames/frame_00000.h5", "scene.toml"])
@pytest.mark.parametrize("damage", ["truncated", "foreign", "empty"])
def test_a_damaged_run_folder_is_named_and_left_as_it_is(
    interrupted: list[str], complaint: Complaint, name: str, damage: str
) -> None:
    file = Path("x") / name
    image = file.read_bytes()
    foreign = b"\x89HDF\r\n\x1a\n" + bytes(200)
    file.write_bytes({"truncated": image[: len(image) // 2], "foreign": foreign, "empty": b""}[damage])
    before = contents()
    line = complaint(*interrupted)
    assert f"x/{name}" in line
    assert contents() == before


def test_a_lost_checkpoint_is_named_and_the_frames_are_kept(
    interrupted: list[str], complaint: Complaint
) -> None:
    Path("x/checkpoint.h5").unlink()
    before = contents()
    assert "x/checkpoint.h5 = missing" in complaint(*interrupted)
    assert contents() == before


def test_another_scene_does_not_continue_a_run(interrupted: list[str], complaint: Complaint) -> None:
    before = contents()
    assert "material.friction = 0.3" in complaint(*interrupted, "--set", "friction=0.3")
    assert "--resume" in complaint(*interrupted[:-1])
    assert contents() == before


def test_a_finished_run_with_damaged_results_is_named(
    small_run: SmallRun, complaint: Complaint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(finish, "draw_pictures", lambda *_: None)
    arguments = [*small_run("time.end=0.02", "tolerance=1e-3"), "--quiet", "--out", "whole"]
    assert cli.main(arguments) == 0
    resume = [*arguments[:-1], "x", "--resume"]
    for name, image in (
        ("results.h5", Path("whole/results.h5").read_bytes()[:-100]),
        ("results.h5", b"not HDF5"),
        ("summary.json", b'{"front": '),
    ):
        shutil.copytree("whole", "x")
        (Path("x") / name).write_bytes(image)
        assert f"x/{name} = " in complaint(*resume)
        # Without its summary the folder is not finished: what is missing would be made from the same results.
        if name == "results.h5":
            Path("x/summary.json").unlink()
            assert f"x/{name} = damaged" in complaint(*resume)
        shutil.rmtree("x")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "magic"], "--method = magic: must be one of auto, gauss_seidel"),
        (["--tol", "nan"], "--tol"),
        (["--tol", "-1"], "--tol"),
        (["--tol", "small"], "--tol"),
    ],
)
def test_bad_options_of_solve(
    problem_file: str, complaint: Complaint, arguments: list[str], message: str
) -> None:
    assert message in complaint("solve", problem_file, *arguments)


def test_bad_problem_files(problem_file: str, complaint: Complaint) -> None:
    assert "nowhere.dat" in complaint("solve", "nowhere.dat")
    Path("text.dat").write_text("no problem here")
    assert "text.dat" in complaint("solve", "text.dat")
    Path("cut.hdf5").write_bytes(Path(problem_file).read_bytes()[:2000])
    assert "cut.hdf5 = truncated or damaged" in complaint("solve", "cut.hdf5")
    for item, change, message in (
        ("fclib_local/vectors/mu", lambda mu: -mu, "mu[0] = -0.5: must be >= 0"),
        ("fclib_local/vectors/mu", lambda mu: mu * np.nan, "mu[0] = nan"),
        ("fclib_local/vectors/q", lambda q: q[:-1], "at most 11, the length of the longest vector"),
        ("fclib_local/W/x", lambda x: x * (1.0 + 0.5 * (np.arange(len(x)) % 12 > 5)), "must be symmetric"),
        ("fclib_local/W/x", lambda x: -x, "positive semi-definite"),
    ):
        shutil.copy(problem_file, "odd.hdf5")
        with h5py.File("odd.hdf5", "r+") as file:
            values = file[item][()]
            del file[item]
            file[item] = change(values)
        assert message in complaint("solve", "odd.hdf5")


def test_an_unknown_command_is_one_line(complaint: Complaint) -> None:
    assert "fly" in complaint("fly")


@pytest.mark.parametrize(
    ("arguments", "code", "start"),
    [
        (["run", "collapse", "--set", "friction=-1"], 2, "barchan: error: material.friction = -1"),
        (["solve", "nowhere.dat"], 2, "barchan: error: nowhere.dat"),
        (["solve", "four.hdf5", "--tol", "1e-300"], 3, "barchan: not converged: certificate"),
    ],
)
def test_the_process_itself_ends_with_the_code_and_one_line(
    problem_file: str, python_environment: dict[str, str], arguments: list[str], code: int, start: str
) -> None:
    command = [sys.executable, "-m", "barchan.cli", *arguments]
    ended = subprocess.run(command, env=python_environment, capture_output=True, text=True)
    assert ended.returncode == code
    assert ended.stderr.startswith(start)
    assert ended.stderr.count("\n") == 1
