"""Write the table of scene keys in docs/scenes.md from the model that checks scene files, so that it stays true.

`python tools/scene_table.py` rewrites the part of the page between the two marks; `--check` only says whether it is current.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pydantic.fields import FieldInfo

from barchan.scenes.kinds import KIND_NAMES
from barchan.scenes.parameters import Group
from barchan.scenes.validation import accepted, known_tables

PAGE = Path(__file__).resolve().parent.parent / "docs" / "scenes.md"
BEGIN = "<!-- begin of the table written by tools/scene_table.py -->\n"
END = "<!-- end of the table written by tools/scene_table.py -->\n"


def table() -> str:
    """Every key of the scene files of every kind in Markdown: one table to each table of a file."""
    lines: list[str] = []
    for kind in KIND_NAMES:
        lines.append(f"\n## Kind `{kind}`")
        for name, group in known_tables(kind).items():
            lines += table_of(name, group)
    return "\n".join(lines) + "\n\n"


def table_of(name: str, group: type[Group]) -> list[str]:
    """The lines of one table; of one whose keys the user names, what stands below each of them."""
    heading, keys = (f"[{name}]", group) if group.entries is None else (f"[{name}.NAME]", group.entries)
    lines = [
        f"\n### `{heading}`\n",
        "| key | meaning and unit | default | accepted |",
        "| --- | --- | --- | --- |",
    ]
    for key, field in keys.model_fields.items():
        cells = (f"`{key}`", field.description or "", default(name, field), accepted(field))
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def default(table_name: str, field: FieldInfo) -> str:
    """The default of a key as it would stand in the file, "none" where it is left out, or "required"."""
    if field.is_required():
        return "required"
    value = field.get_default()
    # Side walls have no default of their own because a plane box has none; in space they slip.
    if value is None and table_name == "walls":
        value = "slip"
    return "none" if value is None else f"`{json.dumps(value)}`"


def with_table(page: str) -> str:
    """The page with its table replaced by the current one. Raises ValueError when it lacks the marks."""
    before, _, rest = page.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{PAGE} lacks the marks of the table")
    return before + BEGIN + table() + END + after


def main(arguments: list[str] | None = None) -> int:
    """Rewrite or check the page; 1 when the check finds it out of date."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; exit code 1 when out of date")
    checking: bool = parser.parse_args(arguments).check
    page = PAGE.read_text(encoding="utf-8")
    current = with_table(page)
    if page == current:
        return 0
    if checking:
        print(f"{PAGE} is out of date: run `make docs`")
        return 1
    PAGE.write_text(current, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
