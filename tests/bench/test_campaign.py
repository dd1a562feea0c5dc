"""A campaign measures what `solve` returns, survives methods and peers that fail, and leaves whole files."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from barchan import friction
from barchan.bench import Plan, problems_of_folder, run_campaign, siconos
from barchan.bench.measurement import Measurement, measure
from barchan.bench.siconos import peer, reduced, siconos_is_there
from barchan.errors import InputError
from barchan.friction.samples import family, sample

OUTPUT = {"results.csv", "results.md", "profile.png", "residuals.png"}
SMALL = [
    (name, problem) for name, problem in family("small") if name in ("s2-ratio1-mu0.3", "s3-ratio1-mu0.3")
]


def test_a_campaign_leaves_tables_and_pictures_and_its_measurements(tmp_path: Path) -> None:
    seen: list[Measurement] = []
    plan = Plan(methods=("aspg", "clarabel_dual"), repeats=1, peers=False)
    campaign = run_campaign(SMALL, plan, tmp_path / "new" / "folder", seen.append)
    assert {path.name for path in (tmp_path / "new" / "folder").iterdir()} == OUTPUT
    assert campaign.measurements == seen and len(seen) == 4 and campaign.peers == ()
    by_solver = {entry.solver: entry for entry in seen if entry.problem == SMALL[1][0]}
    assert by_solver["aspg"].converged and by_solver["aspg"].certificate <= 1e-6
    assert by_solver["aspg"].history[-1][1] == by_solver["aspg"].certificate
    assert "associated" in by_solver["clarabel_dual"].note and not by_solver["clarabel_dual"].converged


def test_a_solve_is_stopped_at_its_limit_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    _, problem = SMALL[1]
    found = measure("any", problem, "aspg", 1e-15, 1e-9, 1)
    assert not found.converged and found.note == "over the time limit" and found.iterations <= 5


def test_each_solve_starts_from_a_problem_without_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    solve = friction.solve
    monkeypatch.setattr(friction, "solve", lambda p, *a, **k: seen.append(p) or solve(p, *a, **k))
    _, problem = SMALL[0]
    measure("any", problem, "aspg", 1e-6, 10.0, 3)
    assert len({id(p) for p in seen}) == 4 and problem not in seen


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"methods": ("auto", "magic")}, "methods = magic: must be one of auto, gauss_seidel"),
        ({"methods": ()}, "methods = none"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"time_limit": 0.0}, "time_limit"),
        ({"repeats": 0}, "repeats"),
    ],
)
def test_a_bad_plan_is_refused(change: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        Plan(**change)


def test_folders_are_read_by_name_and_bad_ones_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no problem file"):
        problems_of_folder(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        problems_of_folder(tmp_path / "nowhere")
    for name in ("b.hdf5", "a.dat"):
        friction.write(tmp_path / name, reduced(SMALL[1][1]))
    (tmp_path / "README.md").write_text("not a problem")
    assert [name for name, _ in problems_of_folder(tmp_path)] == ["a.dat", "b.hdf5"]
    (tmp_path / "c.dat").write_text("3 oops")
    with pytest.raises(InputError, match=r"c\.dat"):
        problems_of_folder(tmp_path)


@pytest.mark.parametrize("s", [2, 3])
def test_the_reduced_form_has_the_same_solutions(s: int) -> None:
    problem = sample(10, s, 1.0, 0.5, seed=1, constraints=2).problem
    solution = friction.solve(problem, tol=1e-9)
    small = reduced(problem)
    assert small.is_reduced and friction.certify(small, solution.r).residual <= 1e-8
    assert reduced(small) is small


class TestPeers:
    @pytest.fixture
    def asked(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Measurement]:
        """`asked(script)` -> the measurement of a peer whose process runs `script` instead of Siconos."""

        def ask(script: str, s: int = 3) -> Measurement:
            child = tmp_path / "child.py"
            child.write_text(script)
            monkeypatch.setattr(siconos, "CHILD", child)
            monkeypatch.setattr(siconos, "START_SECONDS", 1.0)
            problem = next(problem for _, problem in SMALL if problem.s == s)
            return peer("Siconos ADMM")("any", problem, 1e-6, 0.1, 2)

        return ask

    @pytest.mark.parametrize(
        ("script", "note"),
        [
            ("import os; os.abort()", "crashed (SIGABRT)"),
            ("raise RuntimeError('no licence')", "failed with exit code 1: RuntimeError: no licence"),
            ("import time; time.sleep(60)", "killed after 1.4 s"),
            ("", "no answer"),
        ],
    )
    def test_a_peer_that_fails_is_a_note(
        self, asked: Callable[..., Measurement], script: str, note: str
    ) -> None:
        began = time.monotonic()
        found = asked(script)
        assert (found.converged, found.note) == (False, note)
        assert time.monotonic() - began < 10.0

    def test_answers_before_a_crash_count(self, asked: Callable[..., Measurement]) -> None:
        problem = reduced(SMALL[1][1])
        r = friction.solve(problem, tol=1e-9).r
        script = (
            "import os, sys\n"
            "if len(sys.argv) < 9: sys.exit(1)\n"
            "import numpy as np\n"
            f"r = np.array({r.tolist()})\n"
            "np.savez(sys.argv[2], powers=[2, 3], forces=[0 * r, r], seconds=[0.01, 0.02], iterations=[7, 8])\n"
            "os.abort()\n"
        )
        found = asked(script)
        assert found.converged and found.iterations == 8 and found.certificate <= 1e-8
        assert [seconds for seconds, _ in found.history] == [0.01, 0.02]

    def test_a_peer_for_other_sizes_is_not_asked(self, asked: Callable[..., Measurement]) -> None:
        assert asked("raise SystemExit", s=2).note == "not for block size 2"

    @pytest.mark.skipif(not siconos_is_there(), reason="the system's Python has no Siconos")
    @pytest.mark.parametrize(
        ("solver", "s"),
        [("Siconos NSGS", 2), ("Siconos NSGS", 3), ("Siconos ADMM", 3), ("Siconos Newton", 3)],
    )
    def test_siconos_is_judged_by_our_certificate(self, solver: str, s: int) -> None:
        problem = next(problem for _, problem in SMALL if problem.s == s)
        found = peer(solver)("any", problem, 1e-5, 5.0, 2)
        assert found.converged, found.note
        assert found.certificate <= 1e-5 and 0.0 < found.seconds < 5.0
        assert np.isfinite([residual for _, residual in found.history]).any()
