"""Stress-velocity (primal-dual) Newton: the direction of the yield stress as an unknown of its own.

The yield part of the stress is sqrt2 tau_y w with w = g / sqrt(s), s = |g|^2 + eps^2. Newton's method on w(g) converges from
close by only: where eps is small its Jacobian says that a yielding point has no stiffness at all along g. Linearising instead
sqrt(s) w - g = 0 in (w, g) (Chan, Golub and Mulet 1999 for total variation; Aposporidis et al. 2011 for Bingham fluids) gives
the dyad w (x) g in the place of g (x) g / sqrt(s) and, w being eliminated point by point, systems of the same size. |w| <= 1
keeps the tangent semi-definite.
"""

from __future__ import annotations

import numpy as np

from barchan.flows.quasi_newtonian.flow import Fields

RELAXATION = 0.7
"""Share of the new direction where the linearised one leaves the unit ball; the rest is the old one. Of 28 Bingham flows (tau_0
from 1e-3 to 5, eps^2 from 1e-2 to 1e-5) the slowest takes 13 steps with 0.7, 14 with 0.5 and 0.85; two of them fail with 1."""


def flow_direction(fields: Fields) -> np.ndarray:
    """w = g / sqrt(s) (C, Q, 3)."""
    return fields.rate / np.sqrt(fields.s)[..., None]


def next_direction(w: np.ndarray, old: Fields, new: Fields) -> np.ndarray:
    """w + dw (C, Q, 3) of sqrt(s) w = g linearised, (g + dg) / sqrt(s) - w (g : dg) / s, brought back into |w| <= 1."""
    inner = contracted(old.rate, new.rate - old.rate)
    found = new.rate / np.sqrt(old.s)[..., None] - (inner / old.s)[..., None] * w
    length = np.sqrt(contracted(found, found))
    back = (1.0 - RELAXATION) * w + (RELAXATION / np.maximum(length, 1.0))[..., None] * found
    return np.where((length > 1.0)[..., None], back, found)


def contracted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a : b of symmetric tensors (xx, yy, xy) in the last axis."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + 2.0 * a[..., 2] * b[..., 2]
