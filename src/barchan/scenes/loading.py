"""Find a scene by name or file and apply overrides: `load("collapse", friction=0.5)`, `--set material.friction=0.5`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.results.store import read_toml
from barchan.scenes.parameters import SceneParameters
from barchan.scenes.validation import kind_of, known_keys, known_tables, nearest, validate

Tables = dict[str, dict[str, Any]]


def preset_names() -> list[str]:
    """Names of the scenes that come with the package."""
    folder = resources.files("barchan.scenes") / "presets"
    return sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml"))


def load_parameters(scene: str | Path, overrides: Mapping[str, Any]) -> SceneParameters:
    """Validated parameters of a preset or a TOML file with overrides applied.

    Override keys are dotted ("material.friction"), with double underscores ("material__friction"), a bare key
    that exists in one table only ("friction"), or a table name with a dict of keys. Raises InputError.
    """
    tables = read_tables(scene)
    for key in sorted(overrides, key=_changes_the_kind, reverse=True):
        apply_override(tables, key, overrides[key])
    return validate(kind_of(tables).parameters.anchored(tables, Path.cwd()))


def read_tables(scene: str | Path) -> Tables:
    """The tables of a preset or TOML file, not yet validated. Raises InputError when there is no such scene."""
    names = preset_names()
    if str(scene) in names:
        text = (resources.files("barchan.scenes") / "presets" / f"{scene}.toml").read_text(encoding="utf-8")
        return tomllib.loads(text)
    path = Path(scene)
    if path.suffix != ".toml" and not path.exists():
        known = ", ".join(names)
        raise InputError("scene", str(scene), f"one of {known} or a .toml file{nearest(str(scene), names)}")
    tables = read_toml(path)
    return kind_of(tables).parameters.anchored(tables, path.parent)


def parse_setting(text: str) -> tuple[str, Any]:
    """'material.friction=0.5' -> ('material.friction', 0.5); values as in TOML, bare words are texts.

    Raises InputError when there is no '=' or no key.
    """
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise InputError("--set", text, "key=value, for example material.friction=0.5")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def apply_override(tables: Tables, key: str, value: Any) -> None:
    """Put one override into the tables. Raises InputError for a key that is unknown or stands in several tables."""
    if isinstance(value, Mapping) and "." not in key and "__" not in key:
        for inner, item in value.items():
            apply_override(tables, f"{key}.{inner}", item)
        return
    table, *names = _split_key(key, value, kind_of(tables).name)
    place: dict[str, Any] = tables  # a dict of tables at first, then the table to put the value into
    for name in (table, *names[:-1]):
        place = place.setdefault(name, {})
        if not isinstance(place, dict):
            raise InputError(name, place, f"a table [{table}]")
    place[names[-1]] = _plain(value)


def _changes_the_kind(key: str) -> bool:
    return key.replace("__", ".") in ("kind", "scene.kind", "scene")


def _split_key(key: str, value: Any, kind: str) -> list[str]:
    """Table and key (and key within it, of a table whose keys the user names) of a dotted, underscored or bare key."""
    known, dotted = known_keys(kind), key.replace("__", ".")
    parts = dotted.split(".")
    named = [table for table, group in known_tables(kind).items() if group.entries is not None]
    if parts[0] in named and 2 <= len(parts) <= 3:
        return parts
    found = [candidate for candidate in known if candidate == dotted or candidate.split(".")[1] == dotted]
    if len(found) == 1:
        return found[0].split(".")
    if found:
        raise InputError(key, value, "written out as one of " + ", ".join(found))
    guess = nearest(dotted, known) or nearest(parts[-1], [candidate.split(".")[1] for candidate in known])
    raise InputError(key, value, "a parameter of the scene, as in its scene.toml" + guess)


def _plain(value: Any) -> Any:
    """numpy numbers and arrays, tuples, dicts -> what TOML would give."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
