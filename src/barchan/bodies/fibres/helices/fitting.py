"""Super-Helices through given curves: from a groom, drawn or captured, to pieces of constant twist and curvatures.

Every curve is resampled by arc length on a cubic spline, and its pieces get the coordinates that bring their points nearest to
it in the sense of least squares, the root being held at its first point; its frame may tilt. Levenberg and Marquardt's method,
all fibres at once, from two guesses: the turns of the tangent between the ends of the pieces, and their mean curvature and
torsion, which knows of whole turns. (Derouet-Jourdan et al. 2013 go by "floating tangents" instead, piece after piece.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from barchan.bodies.fibres.helices.pieces import Pieces, even_pieces
from barchan.bodies.fibres.model import Vector, Whole
from barchan.bodies.fibres.roots import StillRoots, frames_along
from barchan.errors import InputError

_FINE = 16  # samples of the spline between two given points, for its length
_ITERATIONS = 60
_LITTLE, _STIFFEST = 1e-6, 1e6  # decrease of the squares that ends the iterations, damping that does
_STEEPEST = 4.0  # torsion over curvature of a guess, at most
_FLOOR = 1e-6  # damping of motions that move no point, such as the twist of a straight fibre, over the mean of the others


@dataclass(frozen=True, eq=False)
class Fit:
    """Super-Helices through f curves.

    lengths (p,), firsts (f + 1,) : of the pieces, as `Helices` takes them.  roots : clamped, at the first points.
    curvatures : (p, 3) [1/m].  errors : (f,) root mean square distance to the curve [m].
    """

    lengths: Vector
    firsts: Whole
    roots: StillRoots
    curvatures: Vector
    errors: Vector


def fitted(curves: Sequence[ArrayLike], pieces: int, samples: int = 4) -> Fit:
    """Fibres of `pieces` even pieces through polylines (k_i, 3) [m], root first, by `samples` points on each piece.

    Raises InputError for curves that are not finite points, of less than two, or with two equal ones in a row.
    """
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 2:
        raise InputError("samples", samples, "a whole number >= 2")
    splines = [_spline(number, curve) for number, curve in enumerate(curves)]
    if not splines:
        raise InputError("curves", 0, "one curve at least")
    lengths, firsts = even_pieces([arc[-1] for _, _, arc in splines], pieces)
    cut = Pieces(lengths, firsts)
    count = pieces * samples
    targets, tangents = np.empty((len(splines), count, 3)), np.empty((len(splines), pieces + 1, 3))
    darboux = np.empty((len(splines), pieces, 3))
    for i, (spline, parameters, arc) in enumerate(splines):
        wanted = arc[-1] * np.arange(1, count + 1) / count
        targets[i] = spline(np.interp(wanted, arc, parameters))
        ends = np.interp(arc[-1] * np.arange(pieces + 1) / pieces, arc, parameters)
        tangents[i] = spline(ends, 1)
        darboux[i] = _mean_darboux(spline, ends)
    roots = np.stack([spline(0.0) for spline, _, _ in splines])
    frames = frames_along(tangents[:, 0])
    span = cut.lengths.reshape(len(splines), pieces, 1)
    fits = [_improved(cut, roots, frames, _along(frames, turns), targets, samples)
            for turns in (_tangent_turns(tangents), span * darboux)]  # fmt: skip
    first, second = fits
    better = first.errors <= second.errors
    turned = np.where(better[:, None, None], first.roots.frames, second.roots.frames)
    q = np.where(better[cut.owners][:, None], first.curvatures, second.curvatures)
    return Fit(lengths, firsts, StillRoots(roots, turned), q, np.where(better, first.errors, second.errors))


def _spline(number: int, curve: ArrayLike) -> tuple[CubicSpline, Vector, Vector]:
    """The spline through a polyline, fine parameters on it, and the arc length up to each."""
    points = np.array(curve, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not np.all(np.isfinite(points)):
        raise InputError(f"curves[{number}]", points.shape, "finite points (k, 3), two at least")
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if np.any(chords == 0.0):
        raise InputError(f"curves[{number}]", int(np.argmin(chords)), "without segments of zero length")
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    spline = CubicSpline(knots, points)
    shares = np.arange(_FINE) / _FINE
    parameters = np.append((knots[:-1, None] + shares * chords[:, None]).reshape(-1), knots[-1])
    steps = np.linalg.norm(np.diff(spline(parameters), axis=0), axis=1)
    return spline, parameters, np.concatenate([[0.0], np.cumsum(steps)])


def _mean_darboux(spline: CubicSpline, ends: Vector) -> Vector:
    """(n, 3) mean Darboux vectors in space [1/m] between `ends` (n + 1,): curvature times binormal, torsion times tangent.

    The torsion counts where the curve bends: it is weighted by the square of the curvature.
    """
    shares = (np.arange(_FINE) + 0.5) / _FINE
    at = ends[:-1, None] + shares * np.diff(ends)[:, None]
    speed, second, third = (spline(at, order) for order in (1, 2, 3))
    size = np.linalg.norm(speed, axis=2, keepdims=True)
    bend = np.cross(speed, second) / size**3
    weight = np.sum(bend**2, axis=(1, 2))
    torsion = np.sum(np.cross(speed, second) * third / size**6, axis=(1, 2)) / np.maximum(weight, 1e-300)
    torsion = np.clip(torsion, -_STEEPEST * np.sqrt(weight / _FINE), _STEEPEST * np.sqrt(weight / _FINE))
    return np.mean(bend + torsion[:, None, None] * speed / size, axis=1)


def _tangent_turns(tangents: Vector) -> Vector:
    """(f, n, 3) rotation vectors that take each of the tangents (f, n + 1, 3) to the next the shortest way."""
    unit = tangents / np.linalg.norm(tangents, axis=2, keepdims=True)
    axes = np.cross(unit[:, :-1], unit[:, 1:])
    sines = np.linalg.norm(axes, axis=2, keepdims=True)
    angles = np.arctan2(sines, np.sum(unit[:, :-1] * unit[:, 1:], axis=2, keepdims=True))
    return axes * angles / np.where(sines > 0.0, sines, 1.0)


def _along(frames: Vector, turns: Vector) -> Vector:
    """(f, n, 3) rotation vectors `turns` (f, n, 3) in the frames that start as `frames` (f, 3, 3) and are turned by them."""
    moving, local = frames, np.empty_like(turns)
    for j in range(turns.shape[1]):
        local[:, j] = np.einsum("kji,kj->ki", moving, turns[:, j])
        moving = Rotation.from_rotvec(turns[:, j]).as_matrix() @ moving
    return local


def _improved(
    cut: Pieces, roots: Vector, frames: Vector, turns: Vector, targets: Vector, samples: int
) -> Fit:
    """Levenberg and Marquardt's iterations; unknowns are the angles l q of the pieces, and two tilts of the root."""
    f, count = targets.shape[:2]
    pieces, arcs, offsets = cut.nodes(samples)
    inner = np.ones(len(pieces), bool)
    inner[offsets[:-1]] = False
    pieces, arcs = pieces[inner], arcs[inner]
    per = cut.lengths.reshape(f, -1)
    angles = np.repeat(per, 3, axis=1)
    q = (turns / per[:, :, None]).reshape(-1, 3)

    def residuals(x: Vector, start: Vector) -> Vector:
        return cut.places(x, cut.placed(x, roots, start), pieces, arcs).reshape(f, count, 3) - targets

    miss = residuals(q, frames)
    damping, done = np.full(f, 1e-3), np.zeros(f, bool)
    exact = count * (1e-9 * np.sum(per, axis=1)) ** 2
    for _ in range(_ITERATIONS):
        placed = cut.placed(q, roots, frames)
        places = cut.places(q, placed, pieces, arcs)
        moves = cut.motions(q, placed, pieces, arcs, places)[0].reshape(f, 3 * count, -1) / angles[:, None, :]
        away = places.reshape(f, count, 3) - roots[:, None, :]
        tilts = [np.cross(frames[:, None, :, k], away).reshape(f, 3 * count, 1) for k in (1, 2)]
        jacobian = np.concatenate([moves, *tilts], axis=2)
        normal = np.swapaxes(jacobian, 1, 2) @ jacobian
        slope = np.swapaxes(jacobian, 1, 2) @ miss.reshape(f, -1, 1)
        scale = np.einsum("kii->ki", normal)
        weights = scale + _FLOOR * np.mean(scale, axis=1, keepdims=True)
        change = -np.linalg.solve(
            normal + (damping[:, None] * weights)[:, :, None] * np.eye(scale.shape[1]), slope
        )
        change = change[:, :, 0]
        trial = q + (change[:, :-2] / angles).reshape(-1, 3)
        tilt = change[:, -2:-1] * frames[:, :, 1] + change[:, -1:] * frames[:, :, 2]
        turned = Rotation.from_rotvec(tilt).as_matrix() @ frames
        found = residuals(trial, turned)
        before, after = np.sum(miss**2, axis=(1, 2)), np.sum(found**2, axis=(1, 2))
        better = after < before
        damping = np.clip(np.where(better, 0.2 * damping, 4.0 * damping), 1e-12, _STIFFEST)
        q = np.where(np.repeat(better, per.shape[1])[:, None], trial, q)
        frames = np.where(better[:, None, None], turned, frames)
        miss = np.where(better[:, None, None], found, miss)
        slow = better & (before - after <= _LITTLE * before)
        done |= slow | (damping >= _STIFFEST) | (after <= exact)
        if np.all(done):
            break
    errors = np.sqrt(np.mean(np.sum(miss**2, axis=2), axis=1))
    return Fit(cut.lengths, cut.firsts, StillRoots(roots, frames), q, errors)
