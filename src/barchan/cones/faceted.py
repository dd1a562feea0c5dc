"""Friction with a faceted cone, |r_Tk| <= mu r_N for every component k: not friction, but what linearised cones make of it.

Seed B, 7.1.1 and 7.5.1 (Figure 7.1): Narain et al. (2010) bound the largest of the five deviatoric components of the stress
instead of their norm, and heaps grow corners. No law of a scene is faceted unless asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.cones._checks import FloatArray
from barchan.cones.laws import Law

# Beyond this aperture mu * mu would overflow; the pyramid is then the half-space to rounding.
_WIDEST = 1e100


@dataclass(frozen=True, eq=False)
class FacetedCoulomb(Law):
    """Coulomb's law with the largest tangential component in the place of the norm of the tangential force.

        u_N >= 0,  r_N >= 0,  u_N r_N = 0,    |r_Tk| <= mu r_N  and  r_Tk = -mu r_N sign(u_Tk) where u_Tk != 0,   each k.

    It is not exact friction: with q tangential components the effective coefficient ranges from mu to sqrt(q) mu, depending
    on the direction of the flow (sqrt(5) mu for stresses in space), and turning the axes changes the answer. It is here to
    show that artefact; every other law of this package is round. With q = 1 it is `Coulomb`.

    Like Coulomb's law it is non-associated, and De Saxce's change of variables makes it look associated: with the admissible
    forces K = {r_N >= 0, max_k |r_Tk| <= mu r_N}, whose dual cone is {u_N >= mu sum_k |u_Tk|}, the law says that
    u + s(u) is in that dual cone and orthogonal to r in K, where s(u) = mu sum_k |u_Tk| e_N: the sum, the norm dual to the
    maximum, takes the place of the Euclidean norm. Proof: u_N r_N + sum_k (mu r_N |u_Tk| + r_Tk u_Tk) is a sum of terms >= 0
    on K with u_N >= 0, zero exactly where each is, which is the law. Hence the zeros of `natural_map`, and of the certificate,
    are exactly the law, as for the other laws, and residuals have the same meaning.

    mu : normalised friction coefficient >= 0, number or (n,). Raises InputError on negative, infinite or NaN values.
    Source: seed B, 7.1.1 and 7.5.1; the flow rule by maximum dissipation over the box at the given r_N.
    """

    def _projected(self, blocks: FloatArray) -> FloatArray:
        normal = faceted_normal(blocks, np.asarray(self.mu))
        bound = (np.minimum(self.mu, _WIDEST) * normal)[:, None]
        return np.column_stack([normal, np.clip(blocks[:, 1:], -bound, bound)])

    def _normal_shift(self, velocities: FloatArray) -> FloatArray:
        return np.asarray(self.mu * np.sum(np.abs(velocities[:, 1:]), axis=1))

    def _alart_curnier(self, velocities: FloatArray, forces: FloatArray, steps: FloatArray) -> FloatArray:
        """N part on the half-line, T part component by component on the box of the given r_N, minus r."""
        trial = forces - np.asarray(steps)[..., None] * velocities
        bound = np.maximum(self.mu * forces[:, 0], 0.0)[:, None]
        tangential = np.clip(trial[:, 1:], -bound, bound)
        return np.column_stack([np.maximum(trial[:, 0], 0.0), tangential]) - forces


def faceted_normal(x: FloatArray, mu: FloatArray) -> FloatArray:
    """Normal component (n,) of the nearest points of {x_N >= 0, max_k |x_Tk| <= mu x_N} to x (n, s), `mu` scalar or (n,).

    The tangential components are then clipped to the box. The distance is least where n - x_N = mu sum_k (|x_Tk| - mu n)_+;
    the sum is the largest of its values over the m greatest components, so n is the largest of the roots for each m.
    """
    mu = np.minimum(mu, _WIDEST)
    lengths = -np.sort(-np.abs(x[:, 1:]), axis=1)
    sums = np.column_stack([np.zeros(len(x)), np.cumsum(lengths, axis=1)])
    scale = mu[..., None]
    roots = (x[:, :1] + scale * sums) / (1.0 + scale**2 * np.arange(sums.shape[1]))
    return np.maximum(np.max(roots, axis=1), 0.0)
