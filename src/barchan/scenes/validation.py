"""From untrusted tables to SceneParameters: every defect becomes one InputError naming field, value and allowed range."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from barchan.errors import InputError
from barchan.scenes.parameters import FrictionalWall, SceneParameters, check_geometry

_WALL_ALLOWED = '"stick", "slip" or {friction = F} with F a finite number >= 0'


def validate(tables: Mapping[str, Any]) -> SceneParameters:
    """Scene parameters from nested dicts, as read from TOML, completed with all defaults.

    Raises InputError for the first unknown key (with the nearest known one), missing key, wrong type, NaN,
    infinity or value out of range, and for a column that does not fit the box.
    """
    _reject_unknown_keys(tables)
    try:
        parameters = SceneParameters.model_validate(_with_side_walls(dict(tables)))
    except ValidationError as error:
        raise _first_error(error) from None
    check_geometry(parameters)
    return parameters


def known_tables() -> dict[str, type[BaseModel]]:
    """Table of a scene file -> model of its keys, in order."""
    groups = {}
    for name, field in SceneParameters.model_fields.items():
        assert isinstance(field.annotation, type)
        groups[name] = field.annotation
    return groups


def known_keys() -> list[str]:
    """Every dotted key of a scene file, in order."""
    return [f"{table}.{key}" for table, group in known_tables().items() for key in group.model_fields]


def nearest(word: str, candidates: Iterable[str]) -> str:
    """' (nearest: X)' for the candidate most like `word`, or nothing when none is close."""
    matches = difflib.get_close_matches(word, list(candidates), n=1, cutoff=0.55)
    return f" (nearest: {matches[0]})" if matches else ""


def _reject_unknown_keys(tables: Mapping[str, Any]) -> None:
    groups = known_tables()
    for table, content in tables.items():
        if table not in groups:
            raise InputError(
                table, content, "left out; tables are " + ", ".join(groups) + nearest(table, groups)
            )
        fields = groups[table].model_fields
        if not isinstance(content, Mapping):
            raise InputError(table, content, f"a table [{table}] with keys " + ", ".join(fields))
        for key, value in content.items():
            if key not in fields:
                allowed = "left out; keys are " + ", ".join(fields) + nearest(key, fields)
                raise InputError(f"{table}.{key}", value, allowed)


def _with_side_walls(tables: dict[str, Any]) -> dict[str, Any]:
    """In 3D, side walls that are not given slip."""
    size = tables.get("box", {}).get("size")
    if isinstance(size, list) and len(size) == 3:
        tables["walls"] = {"y_min": "slip", "y_max": "slip", **tables.get("walls", {})}
    return tables


def _first_error(error: ValidationError) -> InputError:
    details = error.errors(include_url=False)[0]
    location = [str(part) for part in details["loc"]]
    table, key = location[0], location[1] if len(location) > 1 else None
    group = known_tables()[table]
    if key is None:
        return InputError(table, "missing", f"a table [{table}] with keys " + ", ".join(group.model_fields))
    field = group.model_fields[key]
    index = f"[{location[2]}]" if len(location) > 2 and location[2].isdigit() else ""
    value = "missing" if details["type"] == "missing" else details["input"]
    return InputError(f"{table}.{key}{index}", value, allowed_values(field))


def allowed_values(field: FieldInfo) -> str:
    """What a field accepts, in words: type, bounds and description with its unit."""
    return f"{accepted(field)} ({field.description})"


def accepted(field: FieldInfo) -> str:
    """Type and bounds of what a field accepts, in words."""
    annotation: Any = field.annotation
    if _is_wall(annotation):
        return _WALL_ALLOWED
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(repr(choice) for choice in get_args(annotation))
    if get_origin(annotation) is list:
        inner, *metadata = get_args(get_args(annotation)[0])
        return f"2 or 3 {'whole' if inner is int else 'finite'} numbers{_bounds(metadata[0].metadata)}"
    if any(getattr(entry, "pattern", None) for entry in field.metadata):
        return "a word of letters, digits and _ . -"
    words = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text"}
    return words[annotation] + _bounds(field.metadata)


def _is_wall(annotation: Any) -> bool:
    return FrictionalWall in get_args(annotation)


def _bounds(metadata: Iterable[Any]) -> str:
    """' > 0 and <= 1' from pydantic's constraints."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    parts = [
        f"{sign} {getattr(entry, name):g}"
        for entry in metadata
        for name, sign in signs.items()
        if hasattr(entry, name)
    ]
    return " " + " and ".join(parts) if parts else ""
