"""Dense flows on the command line: what runs, and every mistake as one line with exit code 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from barchan import cli, reproductions
from barchan.spaces.meshes import rectangle, write_mesh

Complaint = Callable[..., str]
SCENE = """[scene]
name = "mine"
kind = "dense"
dimensionless = true
[mesh]
file = "box.msh"
[boundaries.left]
type = "no_slip"
[boundaries.bottom]
type = "pressure"
pressure = 0.1
[material]
mu = 0.2
"""


@pytest.fixture
def mine() -> str:
    """A scene file on a mesh, in the folder of the test."""
    write_mesh("box.msh", rectangle((0.0, 0.0), (1.0, 1.0), (2, 2)))
    Path("mine.toml").write_text(SCENE)
    return "mine.toml"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["silo", "--set", "reynolds=0"], "material.reynolds = 0: must be a finite number > 0"),
        (["silo", "--set", "reynolds=-3"], "material.reynolds = -3"),
        (["silo", "--set", "dilatancy=0.6"], "material.dilatancy = 0.6: must be at most mu = 0.5"),
        (["silo", "--set", "mu=-0.1"], "material.mu = -0.1"),
        (["silo", "--set", "bingham=nan"], "material.bingham = nan"),
        (["silo", "--set", "outlet=8"], "geometry.outlet = 8.0: must be less than the width 8"),
        (["silo", "--set", "wall=sticky"], "geometry.wall = sticky"),
        (["silo", "--set", "velocity=P9"], "elements.velocity = P9: must be one of 'P1'"),
        (["silo", "--set", "regime=fast"], "flow.regime = fast: must be one of 'creeping', 'inertial'"),
        (["silo", "--set", "box.size=[1, 2]"], "box.size"),
        (["silo", "--set", "kind=solo"], "scene.kind = solo: must be one of 'column'"),
        (["silo", "--set", "method=magic"], "solver.method = magic"),
        (
            ["cylinder", "--set", "diameter=0.95"],
            "geometry.diameter = 0.95: must be at most 0.9 of the width",
        ),
        (["cavity_bingham", "--set", "cells=1"], "geometry.cells = 1"),
        (["poiseuille_bingham", "--set", "velocity=P2", "--set", "imposed=exactly"], "elements.imposed"),
    ],
)
def test_bad_parameters_are_one_line_and_leave_nothing(
    arguments: list[str], message: str, complaint: Complaint
) -> None:
    assert message in complaint("run", *arguments)
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("mesh.file=nowhere.msh", "must be a file that exists"),
        (
            "boundaries.lid={type='no_slip'}",
            "boundaries.lid = unknown: must be a part of the boundary of the mesh: left",
        ),
        ("boundaries.top={type='glue'}", "boundaries.top.type = glue: must be one of 'no_slip'"),
        ("boundaries.top={type='no_slip', speed=1}", "boundaries.top.speed = 1"),
        ("boundaries.top=3", "boundaries.top = 3: must be a table"),
        ("boundaries.top={type='pressure'}", "boundaries.top.pressure = missing"),
        ("boundaries.top={type='no_slip', friction=0.1}", "boundaries.top.friction = 0.1: must be left out"),
        ("boundaries.top={type='friction', friction=-1}", "boundaries.top.friction = -1"),
        ("boundaries.top={type='velocity', value=[1]}", "boundaries.top.value = [1.0]: must be 2 entries"),
        ("boundaries.top={type='stress', stress=[[1]]}", "boundaries.top.stress"),
        ("flow.gravity=[1]", "flow.gravity = [1.0]: must be 2 numbers"),
        ("dilatancy=0.5", "material.dilatancy = 0.5: must be at most mu = 0.2"),
        ("elements.velocity=Q2", "velocity = Q2"),
    ],
)
def test_bad_meshes_and_conditions_are_one_line(
    mine: str, setting: str, message: str, complaint: Complaint
) -> None:
    assert message in complaint("run", mine, "--set", setting)
    assert sorted(path.name for path in Path().iterdir()) == ["box.msh", "mine.toml"]


def test_data_that_no_motion_meets_name_the_boundary(mine: str, complaint: Complaint) -> None:
    closed = [f"boundaries.{part}={{type='velocity', value=[0, 0]}}" for part in ("left", "right", "bottom")]
    pushed = "boundaries.top={type='velocity', value=[0, -1]}"
    line = complaint("run", mine, *(word for setting in (*closed, pushed) for word in ("--set", setting)))
    assert "conditions.top = inflow" in line and "H(mu)" in line
    assert not Path("runs").exists()


def test_a_broken_mesh_file_is_one_line(mine: str, complaint: Complaint) -> None:
    Path("box.msh").write_text("no mesh")
    assert "box.msh" in complaint("run", mine)


def test_a_scene_on_a_mesh_runs_and_runs_again_from_its_folder(
    mine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["run", mine, "--out", "x", "--quiet"]) == 0
    first = Path("x/results.h5").read_bytes()
    assert cli.main(["run", "x/scene.toml", "--out", "y"]) == 0
    assert "greatest pressure" in capsys.readouterr().out
    assert Path("y/results.h5").read_bytes() == first


class TestReproduce:
    def test_without_a_name_there_is_a_list(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["reproduce"]) == 0
        shown = capsys.readouterr().out
        assert all(name in shown for name in reproductions.NAMES)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["beverlo"], "reproduction = beverlo: must be one of poiseuille"),
            (["bagnold", "--processes", "0"], "processes = 0"),
            (["bagnold", "--frobnicate"], "--frobnicate"),
        ],
    )
    def test_mistakes_are_one_line(self, arguments: list[str], message: str, complaint: Complaint) -> None:
        assert message in complaint("reproduce", *arguments)
        assert list(Path().iterdir()) == []

    def test_published_and_computed_figures_stand_beside_each_other(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert cli.main(["reproduce", "bagnold", "--quick", "--out", "x", "--processes", "1"]) == 0
        shown = capsys.readouterr().out
        assert "exact" in shown and "ours" in shown and "x" in shown
        assert {path.name for path in Path("x").iterdir()} == {
            "bagnold.png",
            "profiles.csv",
            "runs",
            "tables.md",
        }
        assert "| ours" in Path("x/tables.md").read_text()
