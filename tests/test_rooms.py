"""The house rule: imports between rooms go downwards only, and every room of the package can be entered."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import barchan

REPOSITORY = Path(__file__).resolve().parents[1]
CHECKER = REPOSITORY / "tools" / "check_rooms.py"


@pytest.fixture(scope="module")
def check_rooms(load_script: Callable[[Path], ModuleType]) -> ModuleType:
    return load_script(CHECKER)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A made-up package in which every import is allowed."""
    root = tmp_path / "barchan"
    for folder in ("cones", "friction/local", "scenes"):
        (root / folder).mkdir(parents=True)
    (root / "__init__.py").write_text("from barchan import scenes\n")
    (root / "errors.py").write_text("import os\n")
    (root / "cones" / "__init__.py").write_text("from ..errors import InputError\n")
    (root / "friction" / "__init__.py").write_text("from barchan.cones import laws\nimport numpy\n")
    (root / "friction" / "local" / "__init__.py").write_text("from .. import problem\n")
    (root / "scenes" / "__init__.py").write_text("from barchan import friction\n")
    return root


def test_the_tree_keeps_the_rule(check_rooms: ModuleType) -> None:
    assert check_rooms.violations(REPOSITORY / "src" / "barchan") == []


def test_a_clean_package_passes(check_rooms: ModuleType, package: Path) -> None:
    assert check_rooms.violations(package) == []


@pytest.mark.parametrize(
    ("statement", "line"),
    [
        ("from barchan.scenes import load", 1),
        ("from barchan import scenes", 1),
        ("import barchan.scenes.presets as presets", 1),
        ("\ndef late():\n    from barchan.scenes import load", 3),
        ("import typing\nif typing.TYPE_CHECKING:\n    from ...scenes import Scene", 3),
        ("from ... import scenes", 1),
    ],
)
def test_an_upward_import_is_reported_with_file_and_line(
    check_rooms: ModuleType, package: Path, statement: str, line: int
) -> None:
    file = package / "friction" / "local" / "sweep.py"
    file.write_text(statement + "\n")
    found = check_rooms.violations(package)
    assert f"{file}:{line}: room friction imports upper room scenes" in found


def test_relative_imports_start_at_the_package_of_the_module(check_rooms: ModuleType, package: Path) -> None:
    (package / "friction" / "scenes.py").write_text("")
    (package / "friction" / "solve.py").write_text("from . import scenes\nfrom .scenes import x\n")
    assert check_rooms.violations(package) == []


def test_rooms_in_a_circle_are_reported(check_rooms: ModuleType, package: Path) -> None:
    (package / "friction" / "late.py").write_text("import barchan.scenes\n")
    assert any("in a circle" in line for line in check_rooms.violations(package))


def test_a_room_nobody_planned_is_reported(check_rooms: ModuleType, package: Path) -> None:
    (package / "utilities.py").write_text("")
    found = check_rooms.violations(package)
    assert found == [f"{package / 'utilities.py'}:1: room utilities is not in the list of rooms"]


def test_the_command_exits_with_one_and_prints_the_violation(package: Path) -> None:
    command = [sys.executable, str(CHECKER), str(package)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0
    (package / "cones" / "up.py").write_text("import barchan.friction\n")
    answer = subprocess.run(command, check=False, capture_output=True, text=True)
    assert answer.returncode == 1
    assert "cones/up.py:1: room cones imports upper room friction" in answer.stdout


def test_importing_barchan_imports_no_room() -> None:
    code = "import sys, barchan; print(sorted(m for m in sys.modules if m.startswith(('barchan', 'numpy'))))"
    answer = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert answer.stdout.strip() == "['barchan', 'barchan._stale']"


@pytest.mark.parametrize("room", [name for name in barchan.__all__ if not name.startswith("_")])
def test_every_room_named_by_the_package_can_be_entered(room: str) -> None:
    assert getattr(barchan, room).__name__ == f"barchan.{room}"
    assert room in dir(barchan)


def test_an_unknown_room_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'cellar'"):
        _ = barchan.cellar
