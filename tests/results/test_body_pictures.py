"""The eye of pictures of bodies in space sees all of the window, and comes as near as it can."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.results.body_solids import camera

SIZES = st.floats(0.05, 5.0)


@settings(max_examples=50, deadline=None)
@given(SIZES, SIZES, SIZES, st.floats(-3.0, 3.0), st.sampled_from([(900, 720), (520, 420), (400, 800)]))
def test_the_corners_of_the_window_are_just_inside_the_picture(
    x: float, y: float, z: float, place: float, pixels: tuple[int, int]
) -> None:
    lower = np.array([place, -place, 0.5 * place])
    upper = lower + np.array([x, y, z])
    eye, middle = camera((lower, upper), pixels, 30.0)
    forward = (middle - eye) / np.linalg.norm(middle - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    corners = np.array([[pair[k] for pair, k in zip(zip(lower, upper, strict=True), ends, strict=True)]
                        for ends in itertools.product((0, 1), repeat=3)])  # fmt: skip
    away = corners - eye
    depth = away @ forward
    assert np.all(depth > 0.0)
    half = np.tan(np.radians(15.0))
    across = np.abs(away @ right) / depth / (half * pixels[0] / pixels[1])
    high = np.abs(away @ up) / depth / half
    assert 0.7 < max(np.max(across), np.max(high)) <= 1.0
