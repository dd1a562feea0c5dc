"""Whitespace-separated tokens of a `.dat` file, taken one after the other and converted many at a time.

Every shortfall (too few tokens, a word where a number belongs, a number that is not finite) is an InputError
that names the file and the item. No equation of the seeds stands here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.friction.files.arrays import Vector

Integers: TypeAlias = NDArray[np.int64]

_LARGEST = 2**31 - 1
_LONGEST_NUMBER = 64


@dataclass
class TokenReader:
    """A cursor over the tokens of one file.

    Attributes
    ----------
    source : the file's name, for messages.
    tokens : all tokens of the file.
    position : index of the next token.
    """

    source: str
    tokens: list[bytes]
    position: int = 0

    @classmethod
    def open(cls, path: Path) -> TokenReader:
        """Split the file at `path` into tokens.

        Raises InputError when the file ends inside a number, which would be read as another one: C prints exponents of two
        digits or more, and none only where the number before has none.
        """
        content = path.read_bytes()
        reader = cls(str(path), content.split())
        if content[-1:].strip() and len(reader.tokens) > 1:
            former, last = reader.tokens[-2:]
            if re.search(rb"e[+-]?\d?$", last) or (b"e" in former and b"." in last and b"e" not in last):
                shown = last[:_LONGEST_NUMBER].decode("ascii", errors="replace")
                raise reader.wrong("last number", shown, "whole (the file is truncated)")
        return reader

    @property
    def remaining(self) -> int:
        """Number of tokens not yet taken."""
        return len(self.tokens) - self.position

    def wrong(self, item: str, value: object, allowed: str) -> InputError:
        """The error for `item` of this file."""
        return InputError(f"{self.source}: {item}", value, allowed)

    def words(self, item: str, count: int) -> list[bytes]:
        """The next `count` tokens, unconverted."""
        if count > self.remaining:
            short = f"{self.remaining} of {count} tokens left"
            raise self.wrong(item, short, "complete (the file is truncated or its sizes are inconsistent)")
        taken = self.tokens[self.position : self.position + count]
        self.position += count
        return taken

    def integers(self, item: str, count: int) -> Integers:
        """The next `count` tokens as integers from 0 to 2^31 - 1, (count,) int64."""
        return self.as_integers(item, self.words(item, count))

    def integer(self, item: str) -> int:
        """The next token as an integer from 0 to 2^31 - 1."""
        return int(self.integers(item, 1)[0])

    def reals(self, item: str, count: int) -> Vector:
        """The next `count` tokens as finite numbers, (count,) float64."""
        return self.as_reals(item, self.words(item, count))

    def as_integers(self, item: str, words: list[bytes]) -> Integers:
        """Tokens already taken as integers from 0 to 2^31 - 1, (len(words),) int64."""
        try:
            values = _table(words).astype(np.int64)
        except (ValueError, OverflowError) as error:
            misfit = _first_misfit(words, int)
            raise self.wrong(item, misfit, "whole numbers (is this a problem file?)") from error
        bad = np.flatnonzero((values < 0) | (values > _LARGEST))
        if len(bad):
            raise self.wrong(item, int(values[bad[0]]), f"from 0 to {_LARGEST}")
        return values

    def as_reals(self, item: str, words: list[bytes]) -> Vector:
        """Tokens already taken as finite numbers, (len(words),) float64."""
        try:
            values = _table(words).astype(np.float64)
        except ValueError as error:
            misfit = _first_misfit(words, float)
            raise self.wrong(item, misfit, "numbers (is this a problem file?)") from error
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise self.wrong(f"{item}[{bad[0]}]", f"{values[bad[0]]}", "finite")
        return values


def _table(words: list[bytes]) -> NDArray[np.bytes_]:
    """Tokens as an array of fixed-length strings; a ValueError if one is too long to be a number."""
    if max(map(len, words), default=0) > _LONGEST_NUMBER:
        raise ValueError("token too long")
    return np.array(words, dtype="S")


def _first_misfit(words: list[bytes], kind: type[int] | type[float]) -> str:
    """The first token that is not a number of this kind, as text for a message."""
    for word in words:
        try:
            kind(word)
        except ValueError:
            return word[:_LONGEST_NUMBER].decode("ascii", errors="replace")
    return "out of range"
