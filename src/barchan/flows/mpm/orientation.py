"""Grains with a direction: their orientation tensor, the friction it makes anisotropic, and the decay of cohesion.

nu = int n n^T psi(n) dn is the second moment of the distribution of the grains' normals n, a symmetric tensor of trace 1
(seed B, 7.4.2): I / d for random normals, n n^T for aligned ones.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.cones import chi, tensor_block_size
from barchan.errors import InputError
from barchan.flows.mpm._orientation_kernels import decay, evolve_orientations, fill_metric_blocks
from barchan.flows.mpm.frames import matrices


def isotropic(count: int, d: int) -> NDArray[np.float64]:
    """Orientation tensors (count, d, d) of random normals, I / d."""
    tensor_block_size(d)
    return np.tile(np.eye(d) / d, (count, 1, 1))


def aligned(normal: ArrayLike, count: int) -> NDArray[np.float64]:
    """Orientation tensors (count, d, d) of grains with one `normal` (d,), of any length but zero: n n^T / |n|^2."""
    vector = np.asarray(normal, dtype=np.float64)
    if vector.shape not in ((2,), (3,)) or not np.all(np.isfinite(vector)) or not np.any(vector):
        raise InputError("normal", normal, "2 or 3 finite numbers, not all zero")
    unit = vector / np.max(np.abs(vector))
    return np.tile(np.outer(unit, unit) / np.sum(unit**2), (count, 1, 1))


def evolved_orientations(
    orientations: ArrayLike,
    gradients: ArrayLike,
    dt: float,
    elongation: float | ArrayLike,
    follow: Literal["tangents", "normals"] = "tangents",
) -> NDArray[np.float64]:
    """Orientation tensors nu (P, d, d) after `dt` seconds in velocity gradients frozen at `gradients` (P, d, d).

    elongation : l in [0, 1], one number or (P,), (L/W - 1) / (L/W + 1) of the grains; 0 turns them with the matter only.
    follow : "tangents", the seed's algorithm, moves the directions along the grains as if each were a fibre; "normals"
        moves the normals as Jeffery's equation has them for plates. See below.

    Seed B's three steps: pi = (I - nu) / (d - 1), the second moment of the directions along the grains, moves by

        D pi/Dt = W pi - pi W + l (D pi + pi D - 2 (D:pi) pi)

    with D and W the symmetric and skew parts of the gradient, then nu = I - (d - 1) pi. Two things differ from the print.
    Eq. (7.26) has W pi + pi W, which is not symmetric: from dp/dt = W p + l (D p - (p.D p) p) follows W pi + pi W^T. And with
    the quadratic closure pi_4 = pi (x) pi the equation is solved exactly, by E pi E^T / Tr(E pi E^T), E = exp(dt (W + l D)),
    where the seed makes one explicit step: for any dt this keeps pi symmetric, positive and of trace 1, and it is objective.

    In 3D the fibres of "tangents" gather along the flow, closer than those of plates can: negative eigenvalues of nu are
    then set to zero and its trace to 1, and a long shear ends with a wide spread of normals, (1/6, 1/3, 1/2) along the flow,
    the vorticity and the gradient for l = 1. With "normals" nu itself moves by dn/dt = W n - l (D n - (n.D n) n), solved
    likewise with E = exp(dt (W - l D)): nothing is clipped, and a shear lays plates parallel to each other. In the plane
    the two are the same.

    Raises InputError for arrays of other shapes, an elongation outside [0, 1] or an unknown `follow`.
    """
    tensors = matrices("orientations", orientations)
    slopes = matrices("gradients", gradients, like=tensors)
    lengths = _numbers("elongation", elongation, len(tensors), 1.0, "from 0 to 1")
    if follow not in ("tangents", "normals"):
        raise InputError("follow", follow, "tangents or normals")
    out = np.empty_like(tensors)
    evolve_orientations(tensors, slopes, _time(dt), lengths, follow == "normals", out)
    return out


def friction_metric(orientations: ArrayLike, anisotropy: float | ArrayLike) -> NDArray[np.float64]:
    """N (q, d, d) with N^-1 = (1 - a) I + d a nu, the tensor that measures friction (seed B, 7.4.2).

    orientations : (q, d, d) tensors nu.
    anisotropy : a in [0, 1), one number or (q,): 0 gives N = I, as random normals do for any a. (At 1 matter with aligned
        normals would have no friction at all along its planes, and no N.)

    Raises InputError for arrays of other shapes or an anisotropy outside [0, 1).
    """
    tensors = matrices("orientations", orientations)
    d = tensors.shape[1]
    share = _numbers("anisotropy", anisotropy, len(tensors), math.nextafter(1.0, 0.0), "from 0 to below 1")
    inverse = (1.0 - share)[:, None, None] * np.eye(d) + (d * share)[:, None, None] * tensors
    try:
        metric = np.linalg.inv(inverse)
    except np.linalg.LinAlgError:
        raise InputError(
            "orientations", "a tensor with a negative eigenvalue", "positive semi-definite"
        ) from None
    return np.ascontiguousarray(0.5 * (metric + np.swapaxes(metric, 1, 2)))


def metric_blocks(metrics: ArrayLike) -> NDArray[np.float64]:
    """Symmetric positive definite blocks G (q, s, s), in chi coordinates, that make anisotropic friction isotropic.

    Friction bounds |N Dev(lambda) N| where it bounds |Dev lambda| otherwise, for metrics N (q, d, d). G keeps the normal
    coordinate and maps deviators to deviators so that |G Dev lambda| = |N Dev(lambda) N| for every one of them: it is the
    square root of the quadratic form tau -> |N tau N|^2 on deviators. With

        lambda~ = G lambda,   gamma~ = G^-1 gamma

    the pair (gamma~, lambda~) obeys the ordinary law of Drucker and Prager if and only if (gamma, lambda) obeys that of
    the norm |N . N|, flow being normal to the section of its cone at constant pressure. The power gamma . lambda is the
    same. So a problem with blocks B is solved with G^-1 B, G^-1 k and gives lambda = G^-1 lambda~.

    Seed B writes Tr/d I + N Dev(lambda) N for this map; N Dev(lambda) N has a trace, which would mix friction with pressure,
    and Dev(N Dev(lambda) N) is a little shorter than it. On shears between eigenvectors of N all three agree.
    """
    return _blocks(metrics, inverse=False)


def inverse_metric_blocks(metrics: ArrayLike) -> NDArray[np.float64]:
    """Inverses G^-1 (q, s, s) of `metric_blocks`, symmetric positive definite too."""
    return _blocks(metrics, inverse=True)


def decayed_cohesion(
    cohesions: ArrayLike, gradients: ArrayLike, decay_rate: float | ArrayLike, dt: float
) -> NDArray[np.float64]:
    """Cohesion (P,) [Pa] after `dt` seconds of dc/dt = -xi |D| c, |D|^2 = D:D / 2, solved exactly (seed B, 7.5.2).

    cohesions : (P,) [Pa]. gradients : (P, d, d) velocity gradients [1/s], frozen.
    decay_rate : xi >= 0, one number or (P,): 0 keeps the cohesion.

    Raises InputError for arrays of other shapes or a decay rate that is negative or not finite.
    """
    slopes = matrices("gradients", gradients)
    values = np.ascontiguousarray(cohesions, dtype=np.float64)
    if values.shape != (len(slopes),):
        raise InputError("cohesions", f"array of shape {values.shape}", f"of shape ({len(slopes)},)")
    rates = _numbers("decay_rate", decay_rate, len(slopes), np.finfo(np.float64).max, "finite and >= 0")
    out = np.empty(len(slopes))
    decay(values, slopes, rates, _time(dt), out)
    return out


def _blocks(metrics: ArrayLike, inverse: bool) -> NDArray[np.float64]:
    tensors = matrices("metrics", metrics)
    size = tensor_block_size(tensors.shape[1])
    blocks = np.empty((len(tensors), size, size))
    fill_metric_blocks(tensors, np.ascontiguousarray(chi(np.eye(size))), inverse, blocks)
    return blocks


def _numbers(
    field: str, value: float | ArrayLike, count: int, largest: float, allowed: str
) -> NDArray[np.float64]:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape not in ((), (count,)):
        raise InputError(
            field, f"array of shape {numbers.shape}", f"one number or {count} numbers, {allowed}"
        )
    if not np.all((numbers >= 0.0) & (numbers <= largest)):
        raise InputError(field, value, allowed)
    return np.ascontiguousarray(np.broadcast_to(numbers, (count,)))


def _time(dt: Any) -> float:
    if not isinstance(dt, (int, float)) or not math.isfinite(dt) or dt < 0.0:
        raise InputError("dt", dt, "a finite number >= 0 (s)")
    return float(dt)
