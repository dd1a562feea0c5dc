"""The documentation says what is so: its table of keys is current, its examples run, its links lead somewhere."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from barchan.scenes.kinds import KIND_NAMES
from barchan.scenes.validation import known_tables, validate

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = sorted([*REPOSITORY.glob("*.md"), *(REPOSITORY / "docs").glob("*.md")])
PICTURES = (".png", ".gif")  # drawn from real runs, not kept by a test


def code_blocks(page: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


@pytest.fixture(scope="module")
def scene_table(load_script: Callable[[Path], ModuleType]) -> ModuleType:
    """The script tools/scene_table.py as a module."""
    return load_script(REPOSITORY / "tools" / "scene_table.py")


def test_the_table_of_scene_keys_is_current_and_complete(scene_table: ModuleType) -> None:
    page = (REPOSITORY / "docs" / "scenes.md").read_text(encoding="utf-8")
    assert page == scene_table.with_table(page), "run `make docs`"
    groups = [group for kind in KIND_NAMES for group in known_tables(kind).values()]
    keys = sum(len((group.entries or group).model_fields) for group in groups)
    assert len(re.findall(r"^\| `\w+` \|", scene_table.table(), re.MULTILINE)) == keys


def test_a_page_that_lost_its_marks_is_reported(scene_table: ModuleType) -> None:
    with pytest.raises(ValueError, match="marks"):
        scene_table.with_table("# Scenes\n")


def test_the_example_scene_is_complete() -> None:
    (example,) = code_blocks(REPOSITORY / "docs" / "scenes.md", "toml")
    assert validate(tomllib.loads(example)).scene.name == "my_column"


def test_the_friction_example_of_the_readme_gives_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    example = code_blocks(REPOSITORY / "README.md", "python")[0]
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    solution = names["solution"]
    assert solution.converged  # type: ignore[attr-defined]
    np.testing.assert_allclose(solution.r, [9.81, 0.0, 9.81, -4.905], atol=1e-9)  # type: ignore[attr-defined]
    np.testing.assert_allclose(solution.u, [0.0, 0.0, 0.0, 1.095], atol=1e-9)  # type: ignore[attr-defined]
    assert "True" in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_examples_are_python(page: Path) -> None:
    for example in code_blocks(page, "python"):
        compile(example, str(page), "exec")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_of_the_repository(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http") and not target.endswith(PICTURES):
            assert (page.parent / target).is_file(), target


def test_every_method_and_local_solver_is_described() -> None:
    from barchan.friction import methods
    from barchan.friction.local import LOCAL_SOLVERS

    solvers = (REPOSITORY / "docs" / "solvers.md").read_text(encoding="utf-8")
    sweeps = (REPOSITORY / "docs" / "sweeps.md").read_text(encoding="utf-8")
    assert [name for name in methods() if f"`{name}`" not in solvers] == []
    plain = [name for name in LOCAL_SOLVERS if "+" not in name]
    assert [name for name in plain if f"`{name}`" not in sweeps] == []
