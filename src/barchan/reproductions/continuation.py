"""Bingham flow past a cylinder for growing yield stress: fixed point, damped Newton, constant weights, continuation.

Seed C, 5.3: Tables 10-13. eta0 = 1e-3, eps = 0.01, until the residual's norm is below 1e-8. The counts say that eps^2 was added
to |g|^2; the last variant of Tables 12 and 13 adds eps itself, as seed C writes for this flow (ERRATA 6).
"""

from __future__ import annotations

from typing import Any

from barchan.flows.quasi_newtonian import Bingham, NonlinearOptions, Weights
from barchan.reproductions.flow_solves import (
    History,
    Wanted,
    agreement,
    beside,
    long_rows,
    solve_all,
)
from barchan.reproductions.workshop import Report, Table, Workshop, published

TITLE = "Bingham fluids of growing yield stress: simple iterations, continuation (seed C, Tables 10-13)"

ETA, EPS = 1e-3, "1e-2"
LEVELS = (2, 3, 4)
ADAPTIVE_LEVEL = 2
TAUS = ("0.001", "0.01", "0.1", "0.5", "1.0", "2.0", "5.0")
COLUMNS = tuple(f"tau_0 = {tau}" for tau in TAUS)
EPSILONS = ("1e-2", "1e-3", "1e-4", "1e-5")
SIMPLE_TAUS = ("1e-4", "1e-3", "1e-2", "1e-1", "1")
QUICK_SIMPLE_TAUS = ("1e-4", "1e-3")
DAMPING = {"1e-4": 1.0, "1e-3": 0.2, "1e-2": 0.1}
"""Seed C gives 0.1 at tau_0 = 1e-2; counts of 99 and 210 steps follow from one start if the damping at 1e-3 was 0.2."""
DELTAS = ("0.1", "0.25", "0.5", "0.6")
CONTINUATION_DELTA = {"eps": 0.0, "tau0": 0.3}
"""delta_0 of every solve of Table 13. Seed C gives none; its first entries in eps are those of Table 12 for 0, with which
ours along the yield stress take five iterations more than the published ones."""
STEPS = {"whole": 0, "halved": None, "itself": None}
"""Steps of the adaptive method: as in seed C; halved where the residual grows, our default; so and with eps added itself."""
WORDS = {"whole": "whole steps", "halved": "halved steps", "itself": "halved steps, eps itself added"}
MOST = 400

Found = dict[tuple[Any, ...], tuple[str, History]]


def reproduce(workshop: Workshop) -> Report:
    """All four tables; quickly the first two on level 2 at small yield stresses. Level 4 takes thousands of steps."""
    simple, simple_tables = _simple(workshop)
    constant, constant_tables = _constant(workshop)
    own = _own(workshop)
    tables = [*simple_tables, *constant_tables]
    adaptive: Found = {}
    for steps in STEPS:
        started, started_table = _started(workshop, own, steps)
        continued, continued_tables = _continued(workshop, steps)
        adaptive.update({**started, **continued})
        tables += [started_table, *continued_tables]
    rest = [
        (f"{sign} = {eps}", *(own[key, tau].count for tau in TAUS))
        for sign, steps in (("eps", ""), ("eps^2", "itself"))
        for eps in _epsilons(workshop)
        for key in (eps + steps,)
    ]
    tables.append(Table("stress-velocity, each flow from rest", ("", *COLUMNS), rest))
    found: Found = {**simple, **constant, **adaptive}
    columns = ("table", "row", "level", "tau0", "published", "ours", "converged", "residual")
    workshop.write_csv("counts.csv", columns, long_rows(found))
    notes = [
        f"Table {name}: {agreement(pair for key, pair in found.items() if key[0] == name)}"
        for name in ("10", "11", *(f"{number} {steps}" for steps in STEPS for number in (12, 13)))
    ]
    most = max(history.iterations for history in own.values())
    late = sum(not history.converged for history in own.values())
    notes.append(
        f"Stress-velocity from rest, without continuation: at most {most} steps, {late} of {len(own)} flows do not converge."
    )
    return Report(tables, notes, late == 0 and all(history.converged for _, history in adaptive.values()))


def most_simple(theirs: str) -> int:
    """Steps after which a slow iteration is given up: twice the published ones and a hundred."""
    return 2 * int(theirs) + 100


def _options(**given: Any) -> NonlinearOptions:
    return NonlinearOptions(**{"tolerance": 1e-8, "relative": False, "max_iterations": MOST, **given})


def _fluid(tau: str, eps: str = EPS, steps: str = "") -> Bingham:
    return Bingham(ETA, float(tau), float(eps) ** (0.5 if steps == "itself" else 1.0))


def _wanted(label: str, level: int, fluids: tuple[Bingham, ...], **options: Any) -> Wanted:
    return Wanted(label, "cylinder_dfg", level, fluids, _options(**options))


def _simple(workshop: Workshop) -> tuple[Found, list[Table]]:
    """Table 10: the fixed point, and Newton with fixed damping."""
    levels = LEVELS[:1] if workshop.quick else LEVELS
    taus = QUICK_SIMPLE_TAUS if workshop.quick else SIMPLE_TAUS
    theirs = {(row["method"], int(row["level"])): row for row in published("fixed_point")}
    keys = [
        (method, level, tau)
        for level in levels
        for method in ("fixed point", "Newton")
        for tau in taus
        if theirs[method, level][tau]
    ]
    wanted = []
    for method, level, tau in keys:
        given: dict[str, Any] = {"method": "fixed-point"}
        if method == "Newton":
            given = {"method": "damped-newton", "damping": DAMPING[tau]}
        label = f"{given['method']}-tau{tau}-level{level}"
        wanted.append(
            _wanted(
                label, level, (_fluid(tau),), max_iterations=most_simple(theirs[method, level][tau]), **given
            )
        )
    ours = {key: found[0] for key, found in zip(keys, solve_all(workshop, wanted), strict=True)}
    rows = [
        (
            f"{method}, level {level}",
            [theirs[method, level][tau] for tau in taus],
            [ours[method, level, tau].count if (method, level, tau) in ours else "" for tau in taus],
        )
        for method in ("fixed point", "Newton")
        for level in levels
    ]
    found = {
        ("10", method, level, tau): (theirs[method, level][tau], history)
        for (method, level, tau), history in ours.items()
    }
    title = "Table 10: nonlinear iterations of the fixed point and of Newton damped by 1, 0.2, 0.1"
    return found, [beside(title, "method", [f"tau_0 = {tau}" for tau in taus], rows)]


def _constant(workshop: Workshop) -> tuple[Found, list[Table]]:
    """Table 11: constant weights of the Newton part."""
    levels, taus = (LEVELS[:1], ("1e-2",)) if workshop.quick else (LEVELS, ("1e-2", "1e-1"))
    deltas = DELTAS[1::2] if workshop.quick else DELTAS
    theirs = {(row["tau0"], int(row["level"])): row for row in published("constant_weights")}
    keys = [(tau, level, delta) for tau in taus for level in levels for delta in deltas]
    wanted = []
    for tau, level, delta in keys:
        weights = Weights(float(delta), float(delta), float(delta))
        wanted.append(
            _wanted(
                f"delta{delta}-tau{tau}-level{level}",
                level,
                (_fluid(tau),),
                max_iterations=most_simple(theirs[tau, level][delta]),
                method="newton",
                delta=weights,
            )
        )
    ours = {key: found[0] for key, found in zip(keys, solve_all(workshop, wanted), strict=True)}
    rows = [
        (
            f"tau_0 = {tau}, level {level}",
            [theirs[tau, level][delta] for delta in deltas],
            [ours[tau, level, delta].count for delta in deltas],
        )
        for tau in taus
        for level in levels
    ]
    found = {
        ("11", f"delta {delta}", level, tau): (theirs[tau, level][delta], history)
        for (tau, level, delta), history in ours.items()
    }
    title = "Table 11: nonlinear iterations with a constant weight"
    return found, [beside(title, "yield stress", [f"delta = {delta}" for delta in deltas], rows)]


def _own(workshop: Workshop) -> dict[tuple[str, str], History]:
    """The stress-velocity method from rest, by eps (with "itself" appended where eps itself is added) and yield stress."""
    cases = [(eps, tau, steps) for eps in _epsilons(workshop) for tau in TAUS for steps in ("", "itself")]
    keys = [(eps + steps, tau) for eps, tau, steps in cases]
    wanted = [
        _wanted(f"stress-velocity-eps{eps}{steps}-tau{tau}", ADAPTIVE_LEVEL, (_fluid(tau, eps, steps),))
        for eps, tau, steps in cases
    ]
    return {key: found[0] for key, found in zip(keys, solve_all(workshop, wanted), strict=True)}


def _epsilons(workshop: Workshop) -> tuple[str, ...]:
    return EPSILONS[:2] if workshop.quick else EPSILONS


def _adaptive(label: str, steps: str, fluids: tuple[Bingham, ...], delta0: float) -> Wanted:
    return _wanted(
        f"{label}-{steps}",
        ADAPTIVE_LEVEL,
        fluids,
        method="adaptive-newton",
        strategy="f1",
        delta0=delta0,
        halvings=STEPS[steps],
    )


def _started(workshop: Workshop, own: dict[tuple[str, str], History], steps: str) -> tuple[Found, Table]:
    """Table 12: the adaptive method from rest, with whole or halved steps."""
    theirs = {row["delta0"]: row for row in published("adaptive_start")}
    keys = [(delta, tau) for delta in theirs for tau in TAUS]
    wanted = [
        _adaptive(f"adaptive-{delta}-tau{tau}", steps, (_fluid(tau, EPS, steps),), float(delta))
        for delta, tau in keys
    ]
    ours = {key: found[0] for key, found in zip(keys, solve_all(workshop, wanted), strict=True)}
    rows = [
        (
            f"delta_0 = {delta}",
            [theirs[delta][tau] for tau in TAUS],
            [ours[delta, tau].count for tau in TAUS],
        )
        for delta in theirs
    ]
    key = EPS + ("itself" if steps == "itself" else "")
    rows.append(("stress-velocity", [""] * len(TAUS), [own[key, tau].count for tau in TAUS]))
    found = {
        (f"12 {steps}", f"delta_0 {delta}", ADAPTIVE_LEVEL, tau): (theirs[delta][tau], history)
        for (delta, tau), history in ours.items()
    }
    title = f"Table 12: nonlinear iterations of the adaptive Newton method (f1) from rest, eps = 0.01, {WORDS[steps]}"
    return found, beside(title, "start", COLUMNS, rows)


def _continued(workshop: Workshop, steps: str) -> tuple[Found, list[Table]]:
    """Table 13: continuation in eps for each yield stress, in the yield stress for each eps; whole or halved steps."""
    epsilons = _epsilons(workshop)
    theirs = {(row["continuation"], row["eps"]): row for row in published("adaptive_newton_continuation")}
    by_eps = [
        _adaptive(
            f"along-eps-tau{tau}",
            steps,
            tuple(_fluid(tau, eps, steps) for eps in epsilons),
            CONTINUATION_DELTA["eps"],
        )
        for tau in TAUS
    ]
    by_tau = [
        _adaptive(
            f"along-tau-eps{eps}",
            steps,
            tuple(_fluid(tau, eps, steps) for tau in TAUS),
            CONTINUATION_DELTA["tau0"],
        )
        for eps in epsilons
    ]
    chains = solve_all(workshop, [*by_eps, *by_tau])
    ours: dict[tuple[str, str, str], History] = {}
    for tau, chain in zip(TAUS, chains[: len(TAUS)], strict=True):
        ours.update({("eps", eps, tau): history for eps, history in zip(epsilons, chain, strict=True)})
    for eps, chain in zip(epsilons, chains[len(TAUS) :], strict=True):
        ours.update({("tau0", eps, tau): history for tau, history in zip(TAUS, chain, strict=True)})
    found = {
        (f"13 {steps}", f"along {along}, eps {eps}", ADAPTIVE_LEVEL, tau): (theirs[along, eps][tau], history)
        for (along, eps, tau), history in ours.items()
    }
    tables = []
    for along, words in (("eps", "eps"), ("tau0", "tau_0")):
        rows = [
            (
                f"eps = {eps}",
                [theirs[along, eps][tau] for tau in TAUS],
                [ours[along, eps, tau].count for tau in TAUS],
            )
            for eps in epsilons
        ]
        tables.append(
            beside(
                f"Table 13: nonlinear iterations, continuation in {words}, {WORDS[steps]}", "", COLUMNS, rows
            )
        )
    return found, tables
