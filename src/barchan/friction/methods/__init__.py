"""Every method of the room, by name: a function (problem, recorder, r0, max_iterations, options...) in a module of its own.

`METHODS` is the only list for friction: `solve`, the command line, the benchmarks read it. `FACETED_METHODS` solve the faceted
law, which only shows what facets do.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from barchan.cones import FacetedCoulomb, Law
from barchan.errors import InputError
from barchan.friction.methods.admm import admm
from barchan.friction.methods.ama import ama
from barchan.friction.methods.apgd import apgd
from barchan.friction.methods.arrow_hurwicz import arrow_hurwicz
from barchan.friction.methods.aspg import aspg
from barchan.friction.methods.auto import auto
from barchan.friction.methods.cadoux import cadoux
from barchan.friction.methods.chambolle_pock import chambolle_pock
from barchan.friction.methods.conic_programs import clarabel_dual, clarabel_primal
from barchan.friction.methods.dual_ama import dual_ama
from barchan.friction.methods.faceted_gauss_seidel import faceted, faceted_gauss_seidel
from barchan.friction.methods.gauss_seidel import gauss_seidel, sor, symmetric_gauss_seidel
from barchan.friction.methods.haslinger import haslinger
from barchan.friction.methods.interior_point import interior_point
from barchan.friction.methods.jacobi import jacobi
from barchan.friction.methods.lemke import lemke
from barchan.friction.methods.newton import (
    newton_alart_curnier,
    newton_de_saxce,
    newton_fischer_burmeister,
)
from barchan.friction.methods.nodal import nodal
from barchan.friction.methods.projected_gradient import projected_gradient
from barchan.friction.methods.proximal_newton import proximal_newton
from barchan.friction.methods.spg import spg
from barchan.friction.methods.split_interior_point import split_interior_point
from barchan.friction.methods.tangent_gradient import tangent_gradient

FIRST_OPTION = 4


class Method(NamedTuple):
    """A way to solve a problem.

    run : the function.  source : where the literature has it.  idea : one line for tables.
    """

    run: Callable[..., None]
    source: str
    idea: str

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options it takes beyond (problem, recorder, r0, max_iterations)."""
        return _options(self.run)


@cache
def _options(run: Callable[..., None]) -> tuple[str, ...]:
    return tuple(inspect.signature(run).parameters)[FIRST_OPTION:]


METHODS: dict[str, Method] = {
    "auto": Method(auto, "this project", "portfolio of the others"),
    "gauss_seidel": Method(gauss_seidel, "seed B, Alg. 4.1", "exact block solves, swept"),
    "symmetric_gauss_seidel": Method(symmetric_gauss_seidel, "seed B, 3.4.3", "forward and backward sweeps"),
    "sor": Method(sor, "seed B, 3.4.3", "over-relaxed Gauss-Seidel"),
    "jacobi": Method(jacobi, "seed B, 3.4.1", "damped block Jacobi"),
    "aspg": Method(aspg, "seed B, Alg. B.2", "accelerated spectral projected gradient"),
    "haslinger": Method(haslinger, "seed B, 2.3.2", "fixed point on frozen sliding thresholds"),
    "cadoux": Method(cadoux, "seed B, Property 2.1", "fixed point on the frozen De Saxce shift"),
    "clarabel_dual": Method(clarabel_dual, "seed B, Eq. 2.21", "conic program in forces, by Clarabel"),
    "clarabel_primal": Method(
        clarabel_primal, "seed B, Eq. 2.24", "conic program in velocities, by Clarabel"
    ),
    "lemke": Method(lemke, "seed B, 3.1.1", "faceted cone, pivots of a linear complementarity problem"),
    "projected_gradient": Method(projected_gradient, "seed B, Alg. 3.1", "gradient step, then projection"),
    "tangent_gradient": Method(
        tangent_gradient, "seed B, Alg. 3.2", "gradient projected on the tangent cone"
    ),
    "spg": Method(spg, "Birgin et al. 2000; Tasora 2013", "spectral steps, nonmonotone line search"),
    "apgd": Method(apgd, "Heyn 2013; Mazhar et al. 2015", "accelerated projected gradient"),
    "ama": Method(ama, "seed B, Alg. 3.5; Goldstein et al. 2014", "alternating minimisation, accelerated"),
    "arrow_hurwicz": Method(
        arrow_hurwicz, "seed B, 3.3.3", "forces and velocities in turn, implicit velocities"
    ),
    "chambolle_pock": Method(
        chambolle_pock, "Chambolle and Pock 2011, Alg. 1-2", "Arrow-Hurwicz with extrapolation"
    ),
    "admm": Method(
        admm, "seed B, Alg. 3.3, 3.4, 3.6; Goldstein et al. 2014", "alternating directions with a penalty"
    ),
    "dual_ama": Method(dual_ama, "seed B, Alg. 3.8", "alternating minimisation without linear solves"),
    "newton_alart_curnier": Method(
        newton_alart_curnier, "seed B, 3.1.2", "Newton on the function of Alart and Curnier"
    ),
    "newton_de_saxce": Method(
        newton_de_saxce, "seed B, 3.1.2", "Newton on the natural map with De Saxce's shift"
    ),
    "newton_fischer_burmeister": Method(
        newton_fischer_burmeister, "seed B, 4.1.1", "Newton on Fischer-Burmeister"
    ),
    "proximal_newton": Method(
        proximal_newton, "this project; seed B, Eq. 3.14", "Newton under a shrinking proximal term"
    ),
    "interior_point": Method(
        interior_point, "this project; seed B, 3.2", "central path, one factorisation a step"
    ),
    "nodal": Method(nodal, "seed B, 4.3.1", "sweeps and corrections in velocities, one contact a vertex"),
    "split_interior_point": Method(
        split_interior_point, "this project", "central path of pressure and friction apart, for flows"
    ),
}

FACETED_METHODS: dict[str, Method] = {
    "auto": Method(faceted, "this project; seed B, 7.1.1", "sweeps and accelerated gradients in turns"),
    "faceted_gauss_seidel": Method(faceted_gauss_seidel, "seed B, 7.1.1", "sweeps component by component"),
}


def method_for(law: Law, name: str) -> Method:
    """The method of this name for a law.

    Raises InputError for a name that does not exist, or that does not solve this law.
    """
    has_facets = isinstance(law, FacetedCoulomb)
    known = FACETED_METHODS if has_facets else METHODS
    if name in known:
        return known[name]
    allowed = "one of " + ", ".join(known)
    if has_facets and name in METHODS:
        allowed += ": the others need a cone without facets"
    raise InputError("method", name, allowed)
