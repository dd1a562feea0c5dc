"""Letters as strokes of a pen, and the script of a stick that writes them in sand (seed B 7.5.2, Fig. 7.20).

A letter is a list of strokes, a stroke the corners of a broken line on a sheet 4 wide and 6 high.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

Vector = NDArray[np.float64]

WIDTH, HEIGHT, GAP = 4.0, 6.0, 2.0

# Each stroke: its corners as pairs of digits, x then y.
_STROKES = {
    "A": "00 26 40;12 32",
    "B": "00 06 36 45 44 33 03;33 42 41 30 00",
    "C": "45 36 16 05 01 10 30 41",
    "D": "00 06 26 44 42 20 00",
    "E": "46 06 00 40;03 33",
    "F": "46 06 00;03 33",
    "G": "45 36 16 05 01 10 30 41 43 23",
    "H": "06 00;46 40;03 43",
    "I": "26 20",
    "J": "46 41 30 10 01",
    "K": "06 00;46 03 40",
    "L": "06 00 40",
    "M": "00 06 23 46 40",
    "N": "00 06 40 46",
    "O": "16 05 01 10 30 41 45 36 16",
    "P": "00 06 36 45 44 33 03",
    "Q": "16 05 01 10 30 41 45 36 16;22 40",
    "R": "00 06 36 45 44 33 03;23 40",
    "S": "45 36 16 05 04 13 33 42 41 30 10 01",
    "T": "06 46;26 20",
    "U": "06 01 10 30 41 46",
    "V": "06 20 46",
    "W": "06 10 23 30 46",
    "X": "06 40;00 46",
    "Y": "06 23 46;23 20",
    "Z": "06 46 00 40",
    "0": "16 05 01 10 30 41 45 36 16;11 35",
    "1": "05 26 20",
    "2": "05 16 36 45 44 00 40",
    "3": "05 16 36 45 44 33 13;33 42 41 30 10 01",
    "4": "30 36 02 42",
    "5": "46 06 04 34 43 41 30 10 01",
    "6": "45 36 16 05 01 10 30 41 42 33 13 02",
    "7": "06 46 10",
    "8": "13 04 05 16 36 45 44 33 13 02 01 10 30 41 42 33",
    "9": "01 10 30 41 45 36 16 05 04 13 33 44",
    " ": "",
}


def strokes_of(text: str, height: float) -> list[Vector]:
    """The strokes of `text`, letters `height` (m) high, each (k, 2) corners (m) from the lower left corner of the text.

    Raises InputError for a text that is empty or has a character without strokes.
    """
    unit = height / HEIGHT
    found = []
    for place, letter in enumerate(text.upper()):
        if letter not in _STROKES:
            raise InputError("text", text, "letters A-Z, digits and blanks")
        for stroke in filter(None, _STROKES[letter].split(";")):
            corners = np.array([[float(digit) for digit in pair] for pair in stroke.split()])
            shift = np.array([place * (WIDTH + GAP), 0.0])
            found.append(unit * (corners + shift))
    if not found:
        raise InputError("text", text, "letters A-Z or digits")
    return found


def text_width(text: str, height: float) -> float:
    """Width (m) of a text with letters `height` (m) high."""
    return height / HEIGHT * (len(text) * (WIDTH + GAP) - GAP)


def pen_script(
    strokes: list[Vector], origin: Vector, lift: float, speed: float, start: float
) -> tuple[Vector, Vector]:
    """Times (n,) s and positions (n, 3) m of a pen that draws the strokes one after the other at `speed` (m/s).

    The pen is at `origin` (3,) m where the text has its lower left corner and the pen is down; it waits `lift` (m) above the
    first stroke until `start` (s), goes down, and is lifted by as much between strokes and at the end.
    """
    path: list[Vector] = []
    for stroke in strokes:
        down = np.column_stack(
            [origin[0] + stroke[:, 0], origin[1] + stroke[:, 1], np.full(len(stroke), origin[2])]
        )
        path += [down[0] + [0.0, 0.0, lift], *down, down[-1] + [0.0, 0.0, lift]]
    points = np.array(path)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = np.concatenate([[True], lengths > 1e-12])
    points = points[kept]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = start + np.concatenate([[0.0], np.cumsum(lengths)]) / speed
    return times, points
