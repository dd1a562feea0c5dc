"""Quasi-Newtonian scenes on the command line: what runs, and every mistake as one line with exit code 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from barchan import cli

Complaint = Callable[..., str]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["couette", "--set", "eps=0"], "material.eps = 0: must be a finite number > 0"),
        (["couette", "--set", "eps=-0.1"], "material.eps = -0.1"),
        (["couette", "--set", "level=0"], "geometry.level = 0: must be a whole number >= 1 and <= 8"),
        (["couette", "--set", "level=9"], "geometry.level = 9"),
        (["couette", "--set", "method=picard"], "solver.method = picard: must be one of 'stress-velocity'"),
        (["couette", "--set", "strategy=f4"], "solver.strategy = f4: must be one of 'f1'"),
        (["couette", "--set", "linear_solver=umfpack"], "solver.linear_solver = umfpack"),
        (
            ["couette", "--set", "shape=triangle", "--set", "linear_solver=multigrid"],
            "elements.shape = triangle: must be 'quadrilateral'",
        ),
        (["couette", "--set", "shape=hexagon"], "elements.shape = hexagon"),
        (
            ["couette", "--set", "elements.pressures=P1"],
            "elements.pressures = P1: must be P1d or P1d_mapped on a quadri",
        ),
        (["couette", "--set", "outer=0.018"], "geometry.outer = 0.018: must be above the inner radius"),
        (["couette", "--set", "speed=100.0"], "speed = 100.0: must be slower"),
        (["couette", "--set", "alpa=0.1"], "(nearest: alpha)"),
        (["cylinder_dfg", "--set", "fluid=honey"], "material.fluid = honey: must be one of 'newtonian'"),
        (["cylinder_dfg", "--set", "fluid=bingham", "--set", "eps=0"], "material.eps = 0"),
        (["cylinder_dfg", "--set", "fluid=shear-thinning", "--set", "exponent=-1"], "material.exponent = -1"),
        (
            ["cylinder_dfg", "--set", "tau0=1"],
            "material.tau0 = 1.0: must be left out of a fluid that is newtonian",
        ),
        (["cylinder_dfg", "--set", "delta0=1.5"], "solver.delta0 = 1.5"),
        (["cylinder_dfg", "--set", "tolerance=0"], "solver.tolerance = 0"),
        (["cylinder_dfg", "--set", "end=-1"], "time.end = -1"),
        (["cylinder_dfg", "--set", "end=1e6"], "time.frame_rate = 10.0: must be such that there are at most"),
        (["cavity", "--set", "bingham=nan"], "material.bingham = nan"),
        (["cavity", "--set", "bingham=-1"], "material.bingham = -1"),
        (["cavity", "--set", "cells=1"], "geometry.cells = 1"),
        (["cavity", "--set", "reynolds=-1"], "material.reynolds = -1"),
    ],
)
def test_bad_parameters_are_one_line_and_leave_nothing(
    arguments: list[str], message: str, complaint: Complaint
) -> None:
    assert message in complaint("run", *arguments)
    assert list(Path().iterdir()) == []


def test_a_scene_shows_its_figures(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", "cylinder_dfg", "--set", "level=1", "--out", "here"]) == 0
    shown = capsys.readouterr().out
    for words in ("drag coefficient", "lift coefficient", "nonlinear iterations", "1534, 130"):
        assert words in shown


def test_too_few_iterations_end_with_exit_code_three(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "level=1", "--set", "max_iterations=1", "--out", "here"]
    assert cli.main(["run", "couette", *settings]) == 3
    assert "not converged: 1 of 1 steps missed the tolerance" in capsys.readouterr().err
