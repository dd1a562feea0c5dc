"""Runs in folders: kill -9 at any moment and resume give the bytes of an uninterrupted run; nothing is ever damaged.

The flow here is the chaotic double of fake_flow.py, so that any bit lost on the way would show.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.scenes import finish
from barchan.scenes.runner import next_step


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures have their own tests."""
    monkeypatch.setattr(finish, "draw_pictures", lambda *_: None)


def interrupted_run(fake_flow: ModuleType, folder: Path, steps: int) -> None:
    """A run that its user interrupts after some steps."""
    scene = fake_flow.fake_scene()
    scene.steps_before_interrupt = steps
    with pytest.raises(KeyboardInterrupt):
        scene.run(folder, progress=False)


def test_killed_at_any_file_operation_and_resumed_the_results_have_the_same_bytes(
    tmp_path: Path, python_environment: dict[str, str]
) -> None:
    script = Path(__file__).with_name("fake_flow.py")
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], env=python_environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    deaths = [line.split() for line in done.stdout.splitlines()]
    # scene, four frames with checkpoints, results, XDMF, summary: killed before and after each
    assert len(deaths) == 2 * (1 + 2 * 4 + 3)
    for _, same, *left in deaths:
        assert same == "True"
        assert left == ["results.h5", "results.xdmf", "scene.toml", "summary.json"]


def test_an_interrupted_run_resumes_to_the_same_bytes(tmp_path: Path, fake_flow: ModuleType) -> None:
    whole = fake_flow.fake_scene().run(tmp_path / "whole", progress=False)
    interrupted_run(fake_flow, tmp_path / "parts", 5)
    resumed = fake_flow.fake_scene().run(tmp_path / "parts", resume=True, progress=False)
    assert (tmp_path / "parts/results.h5").read_bytes() == (tmp_path / "whole/results.h5").read_bytes()
    np.testing.assert_equal(resumed.observables, whole.observables)


def test_a_run_in_memory_gives_the_same_results(tmp_path: Path, fake_flow: ModuleType) -> None:
    stored = fake_flow.fake_scene().run(tmp_path, progress=False)
    kept = fake_flow.fake_scene().run(progress=False)
    assert kept.folder is None
    np.testing.assert_equal(kept.observables, stored.observables)
    np.testing.assert_equal(kept.results.particles(-1), stored.results.particles(-1))
    timings = {"seconds_total", "seconds_per_step"}
    assert {k: v for k, v in kept.summary.items() if k not in timings} == {
        k: v for k, v in stored.summary.items() if k not in timings
    }


def test_frames_fall_on_their_times_and_steps_fill_them(fake_flow: ModuleType) -> None:
    run = fake_flow.fake_scene().run(progress=False)
    assert run.observables["time"] == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-14)
    steps = run.results.steps
    assert steps["dt"] == pytest.approx(0.1 / 3.0)  # the fewest equal steps not longer than 0.04
    assert list(steps["step"]) == list(range(1, 10))


@given(remaining=st.floats(1e-6, 10.0), longest=st.floats(1e-4, 10.0))
def test_steps_divide_what_remains_evenly_and_are_never_too_long(remaining: float, longest: float) -> None:
    dt = next_step(remaining, longest)
    assert dt <= longest * (1.0 + 1e-8)
    count = remaining / dt
    assert count == pytest.approx(round(count), rel=1e-9)
    assert count < remaining / longest + 1.0


def test_a_finished_run_is_returned_as_it_is(tmp_path: Path, fake_flow: ModuleType) -> None:
    first = fake_flow.fake_scene().run(tmp_path, progress=False)
    (tmp_path / "frames").mkdir()  # as if killed while removing its work files
    (tmp_path / "frames" / "frame_00003.h5").write_bytes(b"left over")
    before = (tmp_path / "results.h5").stat().st_mtime_ns
    again = fake_flow.fake_scene().run(tmp_path, resume=True, progress=False)
    assert again.already_finished
    assert not first.already_finished
    assert again.summary == first.summary
    assert (tmp_path / "results.h5").stat().st_mtime_ns == before
    assert not (tmp_path / "frames").exists()


def test_a_run_is_not_overwritten_nor_resumed_with_other_parameters(
    tmp_path: Path, fake_flow: ModuleType
) -> None:
    interrupted_run(fake_flow, tmp_path, 5)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="--resume"):
        fake_flow.fake_scene().run(tmp_path, progress=False)
    with pytest.raises(InputError, match=r"material\.friction = 0\.3: must be 0\.65 as in"):
        fake_flow.fake_scene(friction=0.3).run(tmp_path, resume=True, progress=False)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("name", ["checkpoint.h5", "frames/frame_00000.h5"])
def test_a_damaged_file_is_named_and_the_rest_left_alone(
    tmp_path: Path, fake_flow: ModuleType, name: str
) -> None:
    interrupted_run(fake_flow, tmp_path, 5)
    image = bytearray((tmp_path / name).read_bytes())
    image[len(image) // 2] ^= 1
    (tmp_path / name).write_bytes(image)
    scene_before = (tmp_path / "scene.toml").read_bytes()
    with pytest.raises(InputError, match=rf"{name} = truncated, altered or foreign"):
        fake_flow.fake_scene().run(tmp_path, resume=True, progress=False)
    assert (tmp_path / "scene.toml").read_bytes() == scene_before
    assert (tmp_path / name).read_bytes() == bytes(image)
    assert not (tmp_path / "results.h5").exists()


def test_a_lost_frame_is_named(tmp_path: Path, fake_flow: ModuleType) -> None:
    interrupted_run(fake_flow, tmp_path, 8)
    (tmp_path / "frames/frame_00001.h5").unlink()
    with pytest.raises(InputError, match=r"frame_00001\.h5 = missing"):
        fake_flow.fake_scene().run(tmp_path, resume=True, progress=False)


def test_the_stored_scene_runs_again_to_the_same_bytes(tmp_path: Path, fake_flow: ModuleType) -> None:
    first = fake_flow.fake_scene().run(tmp_path / "first", progress=False)
    stored = fake_flow.scenes.load(tmp_path / "first" / "scene.toml")
    second = fake_flow.FakeScene(stored.parameters).run(tmp_path / "second", progress=False)
    assert first.folder is not None
    assert second.folder is not None
    assert (first.folder / "results.h5").read_bytes() == (second.folder / "results.h5").read_bytes()


def test_progress_goes_to_standard_error_in_tenths(
    tmp_path: Path, fake_flow: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    fake_flow.fake_scene().run(tmp_path)
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert lines[0] == "tiny: from frame 0, t = 0 s of 0.3 s"
    assert any("100 %" in line and "certificate 1.0e-05" in line for line in lines)
