"""The one error type for bad input: it names the field, the value given and what is allowed.

Every room raises it; the command line turns it into a single line and exit code 2 (DESIGN: exit-code contract).
"""

from __future__ import annotations

from typing import Any

_LONGEST_SHOWN_VALUE = 80


class InputError(ValueError):
    """Input that cannot be used.

    Parameters
    ----------
    field : name of the offending parameter, key or file.
    value : what was given (shortened in the message).
    allowed : what would be accepted, read after "must be".
    """

    def __init__(self, field: str, value: Any, allowed: str) -> None:
        self.field = field
        self.value = value
        self.allowed = allowed
        shown = value if isinstance(value, str) else repr(value)
        shown = " ".join(shown.split())
        if len(shown) > _LONGEST_SHOWN_VALUE:
            shown = shown[: _LONGEST_SHOWN_VALUE - 3] + "..."
        super().__init__(f"{field} = {shown}: must be {allowed}")
