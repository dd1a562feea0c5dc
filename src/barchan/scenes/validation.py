"""From untrusted tables to SceneParameters: every defect becomes one InputError naming field, value and allowed range."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from barchan.errors import InputError
from barchan.scenes.kinds import KIND_NAMES, Kind, find_kind
from barchan.scenes.parameters import Group, SceneParameters

Tables = dict[str, type[Group]]


def validate(tables: Mapping[str, Any]) -> SceneParameters:
    """Scene parameters from nested dicts, as read from TOML, completed with all defaults.

    Raises InputError for an unknown kind, the first unknown key (with the nearest known one), missing key,
    wrong type, NaN, infinity or value out of range, and for tables that do not fit together.
    """
    kind = kind_of(tables)
    groups = known_tables(kind.name)
    _reject_unknown_keys(tables, groups)
    try:
        parameters = kind.parameters.model_validate(kind.parameters.completed(dict(tables)))
    except ValidationError as error:
        raise _first_error(error, groups) from None
    parameters.check()
    return parameters


def kind_of(tables: Mapping[str, Any]) -> Kind:
    """The kind that the tables of a scene name. Raises InputError for one that does not exist."""
    header = tables.get("scene")
    named = header.get("kind", KIND_NAMES[0]) if isinstance(header, Mapping) else KIND_NAMES[0]
    return find_kind(named)


def known_tables(kind: str = KIND_NAMES[0]) -> Tables:
    """Table of a scene file of a kind -> model of its keys, in order."""
    groups = {}
    for name, field in find_kind(kind).parameters.model_fields.items():
        assert isinstance(field.annotation, type) and issubclass(field.annotation, Group)
        groups[name] = field.annotation
    return groups


def known_keys(kind: str = KIND_NAMES[0]) -> list[str]:
    """Every dotted key of a scene file of a kind, in order; keys that the user names are left out."""
    return [f"{table}.{key}" for table, group in known_tables(kind).items() for key in group.model_fields]


def nearest(word: str, candidates: Iterable[str]) -> str:
    """' (nearest: X)' for the candidate most like `word`, or nothing when none is close."""
    matches = difflib.get_close_matches(word, list(candidates), n=1, cutoff=0.55)
    return f" (nearest: {matches[0]})" if matches else ""


def _reject_unknown_keys(tables: Mapping[str, Any], groups: Tables) -> None:
    for table, content in tables.items():
        if table not in groups:
            raise InputError(
                table, content, "left out; tables are " + ", ".join(groups) + nearest(table, groups)
            )
        fields = groups[table].model_fields
        if not isinstance(content, Mapping):
            raise InputError(table, content, f"a table [{table}] with keys " + ", ".join(fields))
        if groups[table].entries is not None:
            continue
        for key, value in content.items():
            if key not in fields:
                allowed = "left out; keys are " + ", ".join(fields) + nearest(key, fields)
                raise InputError(f"{table}.{key}", value, allowed)


def _first_error(error: ValidationError, groups: Tables) -> InputError:
    details = error.errors(include_url=False)[0]
    location = [str(part) for part in details["loc"]]
    table, key = location[0], location[1] if len(location) > 1 else None
    group = groups[table]
    if key is None:
        return InputError(table, "missing", f"a table [{table}] with keys " + ", ".join(group.model_fields))
    place = f"{table}.{key}"
    inner = group.entries
    if inner is not None:  # a key named by the user, with a table of its own
        if len(location) < 3 or location[2] not in inner.model_fields:
            found = f"{place}.{location[2]}" if len(location) > 2 else place
            return InputError(found, details["input"], "a table with keys " + ", ".join(inner.model_fields))
        group, key, place, location = inner, location[2], f"{place}.{location[2]}", location[1:]
    field = group.model_fields[key]
    index = f"[{location[2]}]" if len(location) > 2 and location[2].isdigit() else ""
    value = "missing" if details["type"] == "missing" else details["input"]
    return InputError(f"{place}{index}", value, allowed_values(field))


def allowed_values(field: FieldInfo) -> str:
    """What a field accepts, in words: type, bounds and description with its unit."""
    return f"{accepted(field)} ({field.description})"


def accepted(field: FieldInfo) -> str:
    """Type and bounds of what a field accepts, in words; a field may say it itself ("accepted" in its schema)."""
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "accepted" in extra:
        return str(extra["accepted"])
    annotation: Any = field.annotation
    optional = NoneType in get_args(annotation)
    if optional:
        (annotation,) = (choice for choice in get_args(annotation) if choice is not NoneType)
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(repr(choice) for choice in get_args(annotation))
    if get_origin(annotation) is list:
        inner, *metadata = get_args(get_args(annotation)[0])
        return f"2 or 3 {'whole' if inner is int else 'finite'} numbers{_bounds(metadata[0].metadata)}"
    if any(getattr(entry, "pattern", None) for entry in field.metadata):
        return "a word of letters, digits and _ . -"
    words = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text"}
    bounds = field.metadata
    if get_origin(annotation) is Annotated:
        annotation, constraint = get_args(annotation)
        bounds = constraint.metadata
    return words[annotation] + _bounds(bounds)


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
