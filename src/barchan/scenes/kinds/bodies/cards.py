"""Where the cards of a house of cards stand: pairs that lean on each other, flat cards from peak to peak.

A card is a box `length` by `thickness`. One that leans by `lean` (rad) from the vertical stands on one lower corner; the two of
a pair touch with the corners below their peaks. A storey of n pairs carries n - 1 flat cards, each from one peak to the next,
end to end with a gap of half a thickness, and on the middle of each flat card stands a pair of the next storey.
"""

from __future__ import annotations

import math
from itertools import pairwise

_GAP = 0.5  # between the ends of flat cards, in thicknesses


def card_places(
    storeys: int, length: float, thickness: float, lean: float
) -> list[tuple[float, float, float]]:
    """x, z (m) of the centres above the middle of the foot, and counter-clockwise turns (rad) of cards that stand upright.

    From the bottom to the top: the pairs of a storey from left to right, then the flat cards on them.
    """
    pitch = length + _GAP * thickness
    half, wide = 0.5 * length, 0.5 * thickness
    height = length * math.cos(lean) + thickness * math.sin(lean)  # of a leaning card
    reach = wide * math.cos(lean) + half * math.sin(lean)  # from its centre to the corner that leans
    places = []
    foot = 0.0
    for storey in range(storeys):
        pairs = storeys - storey
        peaks = [(number - 0.5 * (pairs - 1)) * pitch for number in range(pairs)]
        for peak in peaks:
            places.append((peak - reach, foot + 0.5 * height, -lean))
            places.append((peak + reach, foot + 0.5 * height, lean))
        foot += height + thickness
        flat = [0.5 * (left + right) for left, right in pairwise(peaks)]
        places += [(x, foot - wide, 0.5 * math.pi) for x in flat]
    return places
