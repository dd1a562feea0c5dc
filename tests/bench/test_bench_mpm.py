"""The comparison with Newton: its step is our friction problem, its failures are notes, its absence leaves our figures."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from barchan import cli, friction
from barchan.bench import Plan, Variant, mpm, mpm_report, newton, run_campaign
from barchan.bench.mpm import EQUAL, NEWTON, OWN, VOXEL, ColumnPlan, compare
from barchan.bench.newton import Newton, NewtonFailure, find_newton
from barchan.bench.newton_problem import Scale, newton_step
from barchan.cones import chi
from barchan.errors import InputError
from barchan.friction.samples import family

SHORT = ColumnPlan(blocks=1, steps=2, warm_up=1, tolerance=1e-3)
SCALE = Scale(voxel=0.1, dt=0.01, density=1000.0, stress=100.0)
NODES, STRAINS, CONTACTS = 5, 4, 3


def newton_tensor(x: np.ndarray) -> np.ndarray:
    """Newton's coordinates (n, 6) as tensors (n, 3, 3), from its documentation: trace, two diagonals, then yz, xz, xy."""
    tensors = np.zeros((len(x), 3, 3))
    tensors += (np.sqrt(2.0 / 3.0) * x[:, 0])[:, None, None] * np.eye(3)
    tensors += x[:, 1][:, None, None] * np.diag([1.0, -1.0, 0.0])
    tensors += (x[:, 2] / np.sqrt(3.0))[:, None, None] * np.diag([-1.0, -1.0, 2.0])
    for k, (i, j) in enumerate(((1, 2), (0, 2), (0, 1))):
        tensors[:, i, j] += x[:, 3 + k]
        tensors[:, j, i] += x[:, 3 + k]
    return tensors


def kept_arrays(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A problem as Newton keeps it: every strain sees every node, each contact two of them; the last has no friction."""
    zeros = np.zeros
    return {
        "inverse_masses": rng.uniform(0.5, 2.0, NODES) / 1000.0,
        "free_velocities": rng.standard_normal((NODES, 3)),
        "yield_parameters": np.tile([1e15 * np.sqrt(1.5), 0.0, 0.0, 0.5e15, 0.0, 0.0], (STRAINS, 1)),
        "strain_offset": rng.uniform(0.0, 0.1, STRAINS),
        "strain": zeros((STRAINS, 6)),
        "compliance": np.zeros(1),
        "strain_offsets": np.arange(0, NODES * STRAINS + 1, NODES),
        "strain_columns": np.tile(np.arange(NODES), STRAINS),
        "strain_values": 0.01 * rng.standard_normal((NODES * STRAINS, 3)),
        "wall_friction": np.array([0.5, 0.3, -1.0]),
        "wall_normals": np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.0, 1.0]]),
        "wall_velocities": zeros((CONTACTS, 3)),
        "wall_offsets": np.array([0, 2, 4, 6, 6, 6]),
        "wall_columns": np.array([0, 1, 2, 3, 3, 4]),
        "wall_values": np.full((6, 1), 0.5),
        "stresses_before": zeros((STRAINS, 6)),
        "impulses_before": zeros((CONTACTS, 3)),
        "velocities": rng.standard_normal((NODES, 3)),
        "stresses": rng.standard_normal((STRAINS, 6)),
        "wall_impulses": rng.standard_normal((CONTACTS, 3)),
    }


class TestProblem:
    @pytest.fixture
    def kept(self) -> dict[str, np.ndarray]:
        return kept_arrays(np.random.default_rng(3))

    def test_strains_are_twice_the_symmetric_gradient(self, kept: dict[str, np.ndarray]) -> None:
        step = newton_step(kept, SCALE)
        u = (step.problem.H @ step.v + step.problem.w).reshape(-1, 6)
        gradients = kept["strain_values"].reshape(STRAINS, NODES, 3)
        slope = np.einsum("ni,knj->kij", kept["velocities"], gradients)
        room = kept["strain_offset"][:, None, None] * (2.0 / 3.0) * np.eye(3)
        assert chi(u[:STRAINS]) == pytest.approx(slope + slope.swapaxes(1, 2) + room)

    def test_velocities_move_as_newton_moves_them(self, kept: dict[str, np.ndarray]) -> None:
        """v = v0 + m^-1 (B^T sigma + C^T impulse), with sigma b for the gradient b of Newton."""
        step = newton_step(kept, SCALE)
        stresses = newton_tensor(kept["stresses"])
        pull = np.einsum("kij,knj->ni", stresses, kept["strain_values"].reshape(STRAINS, NODES, 3))
        for contact in range(2):
            for entry in range(*kept["wall_offsets"][contact : contact + 2]):
                pull[kept["wall_columns"][entry]] += 0.5 * kept["wall_impulses"][contact]
        kept["velocities"] = kept["free_velocities"] + kept["inverse_masses"][:, None] * pull
        moved = newton_step(kept, SCALE)
        assert moved.certificate.balance < 1e-13
        assert np.linalg.norm(moved.v - step.v) > 1e-3
        assert moved.problem.n == STRAINS + 2  # what has no friction coefficient is no contact

    def test_the_friction_is_that_of_the_cone_coordinates(self, kept: dict[str, np.ndarray]) -> None:
        law = newton_step(kept, SCALE).problem.law
        assert law.mu == pytest.approx([0.5 * np.sqrt(2.0 / 3.0)] * STRAINS + [0.5, 0.3])

    def test_a_solution_has_a_certificate_and_newtons_coordinates_give_it_back(
        self, kept: dict[str, np.ndarray]
    ) -> None:
        problem = newton_step(kept, SCALE).problem
        solution = friction.solve(problem, tol=1e-9)
        r = solution.r.reshape(-1, 6)
        kept["stresses"] = 0.5 * np.einsum("kij,cij->kc", chi(r[:STRAINS]), newton_tensor(np.eye(6)))
        kept["velocities"] = solution.v.reshape(-1, 3)
        floor = np.concatenate([np.zeros((STRAINS, 6)), r[STRAINS:]]).reshape(-1)
        pull = (problem.H.T @ floor).reshape(-1, 3)  # half of an impulse at each node of its contact
        kept["wall_impulses"][:2] = 2.0 * pull[[0, 2]]
        assert newton_step(kept, SCALE).certificate.residual < 1e-8

    @pytest.mark.parametrize(
        ("name", "column", "message"),
        [
            ("compliance", None, "compliance"),
            ("yield_parameters", 1, "tensile"),
            ("yield_parameters", 2, "shear"),
        ],
    )
    def test_other_matter_is_refused(
        self, kept: dict[str, np.ndarray], name: str, column: int | None, message: str
    ) -> None:
        kept[name] = kept[name].copy()
        kept[name][..., slice(None) if column is None else column] = 1.0
        with pytest.raises(InputError, match=message):
            newton_step(kept, SCALE)


def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> Path:
    """A child that starts well and answers each request by `body`, in which `say` sends and `request` is at hand."""
    script = tmp_path / "child.py"
    script.write_text(
        "import json, sys, os, numpy as np\n"
        "def say(x): sys.stdout.write(json.dumps(x) + '\\n'); sys.stdout.flush()\n"
        "given = np.load(sys.argv[1])\n"
        "say({'newton': 'fake'})\n"
        "for line in sys.stdin:\n"
        "    request = json.loads(line)\n"
        f"    {body}\n"
    )
    monkeypatch.setattr(newton, "CHILD", script)
    return Path(sys.executable)


ANSWER = (
    "np.save(os.path.join(request['keep'], 'positions.npy'), given['positions']) if request['keep'] else None; "
    "say({'time': 0.0, 'steps': [{'seconds': 0.5, 'processor': 0.4, 'solve': None, 'checks': 2, 'residuals': [1e-5, 1e-4]}]"
    " * request['steps']})"
)


class TestPeer:
    def test_answers_are_read(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        interpreter = fake(tmp_path, monkeypatch, ANSWER)
        with Newton(interpreter, {"positions": np.eye(3)}) as peer:
            assert peer.versions == {"newton": "fake"}
            steps, positions = peer.advance(2, True)
        assert positions == pytest.approx(np.eye(3))
        assert [step.seconds for step in steps] == [0.5, 0.5] and steps[0].kept == {}

    def test_a_crash_says_why(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        interpreter = fake(tmp_path, monkeypatch, "raise RuntimeError('no grid')")
        with (
            Newton(interpreter, {"positions": np.eye(3)}) as peer,
            pytest.raises(NewtonFailure, match="no grid"),
        ):
            peer.advance(1, False)

    def test_a_peer_that_does_not_start_says_why(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        script = tmp_path / "child.py"
        script.write_text("raise SystemExit('no newton here')")
        monkeypatch.setattr(newton, "CHILD", script)
        with pytest.raises(NewtonFailure, match="code 1: no newton here"):
            Newton(Path(sys.executable), {})

    def test_a_peer_that_hangs_is_killed(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(newton, "PATIENCE", 3.0)
        interpreter = fake(tmp_path, monkeypatch, "import time; time.sleep(60)")
        with (
            Newton(interpreter, {"positions": np.eye(3)}) as peer,
            pytest.raises(NewtonFailure, match="code -9"),
        ):
            peer.advance(1, False)

    def test_an_interpreter_without_newton_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with pytest.raises(InputError, match="can import newton"):
            find_newton(Path("/no/such/python"))
        monkeypatch.setenv(newton.VARIABLE, "/no/such/python")
        with pytest.raises(InputError, match="can import newton"):
            find_newton()


class TestComparison:
    def test_a_failing_peer_is_a_note_and_ours_go_on(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        found = compare(SHORT, fake(tmp_path, monkeypatch, "raise RuntimeError('no grid')"))
        assert len(found.notes) == 1 and "no grid" in found.notes[0]
        assert len(found.of(OWN)) == 2 and not found.of(NEWTON) and not found.of(EQUAL)
        assert all(step.certificate <= SHORT.tolerance for step in found.of(OWN))

    def test_a_newton_that_hides_its_problems_is_timed_without_certificate(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        found = compare(SHORT, fake(tmp_path, monkeypatch, ANSWER))
        assert found.notes == [] and not found.of(EQUAL)
        assert np.isnan([step.certificate for step in found.of(NEWTON)]).all()
        assert found.ratio(OWN) == pytest.approx(0.5 / found.median_seconds(OWN))
        mpm_report.write_report(tmp_path / "out", SHORT, found)
        rows = (tmp_path / "out" / "steps.csv").read_text().splitlines()
        assert len(rows) == 5 and rows[1].startswith("Newton,0,0,500,400,50,nan")

    def test_both_begin_from_the_same_column(self) -> None:
        grid, _, state = mpm.column(SHORT)
        assert state.particle_count == 8 * 8 * 11 * 8
        shape = mpm._shape(OWN, 0.0, state.positions)
        assert shape.mean_height == pytest.approx(0.5 * 11 * VOXEL) and shape.excess == 0.0
        centre = 0.5 * (grid.origin + grid.upper)[:2]
        assert state.positions[:, :2].mean(axis=0) == pytest.approx(centre)

    @pytest.mark.parametrize(
        "change",
        [{"blocks": 0}, {"steps": 0}, {"tolerance": 0.0}, {"tolerance": float("nan")}, {"threads": 0}],
    )
    def test_a_bad_plan_is_refused(self, change: dict) -> None:
        with pytest.raises(InputError, match=next(iter(change))):
            ColumnPlan(**change)

    @pytest.mark.slow
    @pytest.mark.skipif(find_newton() is None, reason="there is no Newton")
    def test_newton_is_judged_by_our_certificate(self) -> None:
        found = compare(ColumnPlan(blocks=2, steps=3, warm_up=1), find_newton())
        assert found.notes == []
        theirs = [step.certificate for step in found.of(NEWTON)]
        assert len(theirs) == 6 and max(theirs) < 0.05
        assert found.no_worse == 1.0
        for entry in found.same:
            assert entry.certificate <= max(entry.newton_certificate, 1e-12)
        theirs_first, ours_first = found.shapes[0], found.shapes[1]
        assert (theirs_first.solver, ours_first.solver) == (NEWTON, EQUAL)
        assert ours_first.mean_height == pytest.approx(theirs_first.mean_height, rel=0.02)


class TestCommand:
    def test_our_figures_alone(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.chdir(tmp_path)
        command = ["bench", "mpm", "--alone", "--blocks", "1", "--steps", "2", "--tol", "1e-3"]
        assert cli.main(command) == 0
        out = tmp_path / "runs" / "bench-mpm-1"
        assert {path.name for path in out.iterdir()} == set(mpm_report.FILES)
        figures = json.loads((out / "results.json").read_text())
        assert list(figures["solvers"]) == [OWN] and figures["particles"] == 5632
        assert "barchan alone" in capsys.readouterr().out

    def test_bad_options_are_one_line(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["bench", "mpm", "--newton", str(tmp_path / "python")]) == 2
        assert "can import newton" in capsys.readouterr().err
        assert cli.main(["bench", "mpm", "--alone", "--steps", "0"]) == 2
        assert "steps = 0" in capsys.readouterr().err


def test_variants_of_a_method_compete_under_their_names(tmp_path: Path) -> None:
    variants = (
        Variant("stored", "gauss_seidel", {"operator": "explicit"}),
        Variant("plain", "gauss_seidel"),
    )
    problems = [entry for entry in family("small") if entry[0] == "s3-ratio1-mu0.3"]
    campaign = run_campaign(problems, Plan(methods=(), variants=variants, repeats=1, peers=False), tmp_path)
    assert [entry.solver for entry in campaign.measurements] == ["stored", "plain"]
    assert all(entry.converged for entry in campaign.measurements)
    with pytest.raises(InputError, match="magic"):
        Plan(variants=(Variant("x", "magic"),))
