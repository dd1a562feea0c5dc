"""The problem in equilibrated unknowns x_i = r_i / sqrt(rho_i), common to all methods that project forces.

Rates become sqrt(rho_i) u_i and W gets diagonal blocks of mean eigenvalue 1, while the cones keep their shape (seed B
3.3.2 takes W as it is). Set up once per problem; the bound on W once per operator, shared by all variants.
"""

from __future__ import annotations

import numpy as np

from barchan.cones import FacetedCoulomb
from barchan.friction._faceted_kernels import project_faceted_blocks
from barchan.friction._kernels import project_blocks
from barchan.friction.methods._norms import eigenvalue_bound
from barchan.friction.operators import Delassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual


class ScaledProblem:
    """Equilibrated problem: `root` (n, 1) = sqrt(rho), `laws` (n, 4) parameters of the scaled admissible sets.

    `associated` : no block has a De Saxce shift, so that forces minimise x . W x / 2 + x . b over convex sets.
    Arrays x (scaled forces) and u (scaled rates) are (n, s).
    """

    def __init__(self, problem: Problem, delassus: Delassus) -> None:
        self.problem = problem
        self.delassus = delassus
        self.root = np.sqrt(problem.rho)[:, None]
        self.laws = problem.parameters.copy()
        self.laws[:, 1:3] /= self.root
        self.excess = self.laws[:, 0] - self.laws[:, 3]
        self.associated = not self.excess.any()

    def start(self, r0: np.ndarray) -> np.ndarray:
        """Admissible scaled forces nearest to the forces r0 (n, s)."""
        return self.project(r0 / self.root)

    def product(self, x: np.ndarray) -> np.ndarray:
        """Scaled W x: one product with W."""
        return self.root * self.delassus.apply(self.root * x)

    def rates(self, x: np.ndarray) -> np.ndarray:
        """sqrt(rho) (W r + b): one product with W."""
        return self.root * (self.delassus.apply(self.root * x) + self.delassus.b)

    def project(self, x: np.ndarray) -> np.ndarray:
        """Projection of every block on its scaled admissible set."""
        out = np.empty_like(x)
        project_blocks(x, self.laws, out)
        return out

    def shift(self, u: np.ndarray) -> np.ndarray:
        """Normal part (n,) of s(u)."""
        return np.asarray(self.excess * np.linalg.norm(u[:, 1:], axis=1))

    def shifted(self, u: np.ndarray) -> np.ndarray:
        """u + s(u) (n, s); u itself for associated laws."""
        if self.associated:
            return u
        out = u.copy()
        out[:, 0] += self.shift(u)
        return out

    def residual(self, r: np.ndarray) -> float:
        """Law residual of forces r (n, s), in the certificate's definition: one product with W."""
        return law_residual(self.problem, r, self.delassus.apply(r) + self.delassus.b)[0]

    def residual_at(self, x: np.ndarray, u: np.ndarray) -> float:
        """Law residual of scaled forces whose scaled rates are known."""
        return law_residual(self.problem, self.root * x, u / self.root)[0]

    @property
    def lipschitz(self) -> float:
        """Upper bound of the largest eigenvalue of the scaled W (1 for W = 0), made once per operator."""
        shape = (self.problem.n, self.problem.s)
        key = ("lipschitz", type(self.delassus).__name__)
        bound = self.problem.origin.prepared(key, lambda: eigenvalue_bound(self.product, shape))
        return bound if bound > 0.0 else 1.0


class FacetedScaledProblem(ScaledProblem):
    """The same for `FacetedCoulomb`: its cones keep their shape too."""

    def project(self, x: np.ndarray) -> np.ndarray:
        """Projection of every block on its pyramid."""
        out = np.empty_like(x)
        project_faceted_blocks(x, self.laws, out)
        return out

    def shift(self, u: np.ndarray) -> np.ndarray:
        """Normal part (n,) of s(u) = mu sum_k |u_Tk| e_N."""
        return np.asarray(self.excess * np.abs(u[:, 1:]).sum(axis=1))


def scaled_problem(problem: Problem, operator: str = "auto") -> ScaledProblem:
    """The equilibrated problem on the operator of this kind (see `barchan.friction.operators`), made once."""
    kind = FacetedScaledProblem if isinstance(problem.law, FacetedCoulomb) else ScaledProblem
    scaled: ScaledProblem = problem.prepared(
        ("scaled", operator), lambda: kind(problem, build_operator(problem, operator))
    )
    return scaled
