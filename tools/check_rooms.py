"""Check which way the imports between the rooms of barchan go: a lower room never imports an upper one.

A room is a direct child of `src/barchan`, package or module; `barchan/__init__.py` stands above all of them.
Imports count wherever they stand (at the top, inside a function, under TYPE_CHECKING), absolute or relative.
"""

from __future__ import annotations

import argparse
import ast
import graphlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = "barchan"
ROOMS = (
    "_stale",
    "errors",
    "storage",
    "cones",
    "linalg",
    "friction",
    "spaces",
    "bodies",
    "flows",
    "results",
    "bench",
    "scenes",
    "reproductions",
    "cli",
)
"""The rooms from the ground up; a room may import those before it in this list."""


@dataclass(frozen=True)
class RoomImport:
    """One import that leaves its room: where it stands, and from which room into which."""

    file: Path
    line: int
    importer: str
    imported: str


def room_of(file: Path, root: Path) -> str | None:
    """The room that holds `file`, or None for the `__init__.py` of the package `root` itself."""
    parts = file.relative_to(root).with_suffix("").parts
    return None if parts == ("__init__",) else parts[0]


def imported_modules(tree: ast.AST, module: tuple[str, ...], is_package: bool) -> Iterator[tuple[int, str]]:
    """Line and dotted name of all that a module imports, relative imports resolved.

    Parameters
    ----------
    tree : the parsed module.
    module : its dotted name, split at the dots.
    is_package : whether it is an `__init__.py`, whose relative imports start at itself.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base: tuple[str, ...] = ()
            if node.level:
                base = module[: len(module) - node.level + (1 if is_package else 0)]
            base += tuple(node.module.split(".")) if node.module else ()
            for alias in node.names:
                yield node.lineno, ".".join((*base, alias.name))


def room_imports(root: Path) -> Iterator[RoomImport]:
    """Every import of the package `root` that crosses from one room into another."""
    for file in sorted(root.rglob("*.py")):
        importer = room_of(file, root)
        if importer is None:
            continue
        parts = file.relative_to(root).with_suffix("").parts
        is_package = parts[-1] == "__init__"
        module = (PACKAGE, *(parts[:-1] if is_package else parts))
        tree = ast.parse(file.read_text(encoding="utf-8"), filename=str(file))
        for line, name in imported_modules(tree, module, is_package):
            package, _, rest = name.partition(".")
            imported = rest.partition(".")[0]
            if package != PACKAGE or imported == importer:
                continue
            # `from barchan import __version__` and the like name no room.
            if (root / imported).is_dir() or (root / f"{imported}.py").is_file() or imported in ROOMS:
                yield RoomImport(file, line, importer, imported)


def violations(root: Path, rooms: tuple[str, ...] = ROOMS) -> list[str]:
    """One line of text for everything that is wrong in the package `root`; empty when all is well."""
    height = {room: floor for floor, room in enumerate(rooms)}
    files = (file for file in sorted(root.rglob("*.py")) if room_of(file, root) is not None)
    present = {room: file for file in files if (room := room_of(file, root)) is not None}
    found = [
        f"{file}:1: room {room} is not in the list of rooms"
        for room, file in sorted(present.items())
        if room not in height
    ]
    needs: dict[str, set[str]] = {}
    for step in room_imports(root):
        needs.setdefault(step.importer, set()).add(step.imported)
        if height.get(step.imported, -1) > height.get(step.importer, len(rooms)):
            found.append(f"{step.file}:{step.line}: room {step.importer} imports upper room {step.imported}")
    try:
        graphlib.TopologicalSorter(needs).prepare()
    except graphlib.CycleError as error:
        found.append(f"{root}: rooms import each other in a circle: {' <- '.join(error.args[1])}")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Print every violation; 0 when there is none, 1 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).resolve().parent.parent / "src" / PACKAGE
    parser.add_argument("root", nargs="?", type=Path, default=default, help="the package folder")
    root: Path = parser.parse_args(arguments).root
    if not root.is_dir():
        parser.error(f"{root} is not a folder")
    found = violations(root)
    for line in found:
        print(line)
    if not found:
        print(f"{root.name}: imports between rooms all go downwards")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
