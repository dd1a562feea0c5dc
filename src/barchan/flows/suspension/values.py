"""Numbers that come from people, checked."""

from __future__ import annotations

import math
from typing import Any

from barchan.errors import InputError


def checked(field: str, value: Any, *, positive: bool = True) -> float:
    """`value` as a finite number > 0, or >= 0 unless `positive`; InputError names `field`."""
    allowed = "a finite number > 0" if positive else "a finite number >= 0"
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if not math.isfinite(number) or number < 0.0 or (positive and number == 0.0):
        raise InputError(field, value, allowed)
    return number
