"""Pictures of plane velocity fields by line-integral convolution: noise smeared along stream lines (Cabral and Leedom 1993).

Hue is direction, brightness amplitude, as in seed B, Fig. 8.4.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Vector = NDArray[np.float64]

_STEP = 0.7  # pixels
_STEPS = 22  # in each direction
_CONTRAST = 1.6


def convolved_noise(across: Vector, upwards: Vector, seed: int = 0) -> Vector:
    """(p, q) grey values in [0, 1]: noise averaged along the stream lines of the field (p, q) given pixel by pixel."""
    speed = np.hypot(across, upwards)
    safe = np.maximum(speed, 1e-300)
    direction = (across / safe, upwards / safe)
    noise = np.random.default_rng(seed).random(across.shape)
    total, start = noise.copy(), np.indices(across.shape).astype(np.float64)
    for sign in (1.0, -1.0):
        places = start.copy()
        for _ in range(_STEPS):
            step = [_sampled(part, places) for part in direction]
            places += sign * _STEP * np.stack(step)
            total += _sampled(noise, places)
    mean = total / (2 * _STEPS + 1)
    spread = float(mean.std()) or 1.0
    return np.asarray(np.clip(0.5 + _CONTRAST / 6.0 * (mean - mean.mean()) / spread, 0.0, 1.0))


def direction_image(across: Vector, upwards: Vector, top: float, pixels: int = 420) -> Vector:
    """(q, p, 3) colours of the field (n, m) on a regular grid, rows upwards: hue its direction, brightness its amplitude.

    top : speed (m/s) of full brightness.  pixels : along the first axis.
    """
    n, m = across.shape
    shape = (pixels, max(2, round(pixels * (m - 1) / (n - 1))))
    places = np.stack(np.meshgrid(
        np.linspace(0.0, n - 1.0, shape[0]), np.linspace(0.0, m - 1.0, shape[1]), indexing="ij"
    ))  # fmt: skip
    u, w = _sampled(across, places), _sampled(upwards, places)
    grey = convolved_noise(u, w)
    hue = (np.arctan2(w, u) / (2.0 * np.pi)) % 1.0
    value = np.sqrt(np.clip(np.hypot(u, w) / top, 0.0, 1.0)) * (0.25 + 0.75 * grey)
    image = hsv_to_rgb(np.stack([hue, np.full(shape, 0.75), value], axis=-1))
    return np.asarray(np.swapaxes(image, 0, 1))


def _sampled(values: Vector, places: Vector) -> Vector:
    """`values` (n, m) at `places` (2, ...) in units of their grid, linearly; beyond the edge that of the edge."""
    return np.asarray(map_coordinates(values, places, order=1, mode="nearest"))
