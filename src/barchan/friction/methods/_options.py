"""Checks that the options of several methods share; each raises InputError naming the option."""

from __future__ import annotations

import math

from barchan.errors import InputError


def check_positive(**options: float | None) -> None:
    """Every option given (not None) is a finite positive number."""
    for name, value in options.items():
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(name, value, "finite and > 0")


def check_counts(**options: int) -> None:
    """Every option is at least 1."""
    for name, value in options.items():
        if value < 1:
            raise InputError(name, value, "at least 1")


def check_choice(name: str, value: str, allowed: tuple[str, ...]) -> None:
    """The option is one of the allowed words."""
    if value not in allowed:
        raise InputError(name, value, "one of " + ", ".join(allowed))
