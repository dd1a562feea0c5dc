"""Scene parameters as TOML text that a person can read, edit and run again: every key with its value and its meaning."""

from __future__ import annotations

import json
import re
from typing import Any

from pydantic import BaseModel

from barchan.scenes.parameters import SceneParameters


def to_toml(parameters: SceneParameters) -> str:
    """Complete TOML text of the parameters, defaults included; loading it gives equal parameters."""
    parts = [f"# A barchan scene, {parameters.units}. Run it with: barchan run scene.toml\n"]
    for table in type(parameters).model_fields:
        group: BaseModel = getattr(parameters, table)
        parts.append(f"\n[{table}]\n")
        for key, field in type(group).model_fields.items():
            value = getattr(group, key)
            if value is not None:
                parts.append(f"{key} = {_value(value)}  # {field.description}\n")
        for key, value in (group.model_extra or {}).items():
            parts.append(f"{_key(key)} = {_value(value)}\n")
    return "".join(parts)


def _key(name: str) -> str:
    """A TOML key, quoted where it is no bare word."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _value(name)


def _value(value: Any) -> str:
    """A TOML value."""
    if isinstance(value, BaseModel):
        given = {key: getattr(value, key) for key in type(value).model_fields}
        inside = ", ".join(f"{key} = {_value(item)}" for key, item in given.items() if item is not None)
        return f"{{ {inside} }}"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a JSON string is a TOML basic string, but for the one control character that only TOML forbids
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
