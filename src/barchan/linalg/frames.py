"""Orthonormal frames of contacts: a normal and tangents."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def contact_frames(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, d, d) orthonormal frames whose first rows are the unit `normals` (k, d), d = 2 or 3; the others are tangents."""
    d = normals.shape[1]
    frames = np.empty((len(normals), d, d))
    frames[:, 0] = normals
    if d == 2:
        frames[:, 1, 0], frames[:, 1, 1] = -normals[:, 1], normals[:, 0]
        return frames
    axis = np.argmin(np.abs(normals), axis=1)
    first = np.eye(3)[axis] - normals * np.take_along_axis(normals, axis[:, None], axis=1)
    frames[:, 1] = first / np.linalg.norm(first, axis=1)[:, None]
    frames[:, 2] = np.cross(frames[:, 0], frames[:, 1])
    return frames
