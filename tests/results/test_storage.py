"""Storage of runs: sealed files, run folders, assembly, reading back."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan import results
from barchan.errors import InputError
from barchan.results import FolderStore, MemoryStore, assemble, claim_folder, frame_tree, results_in_memory
from barchan.results.sealed import read_sealed, seal, unseal, write_sealed
from barchan.results.store import CHECKPOINT_FILE, RESULTS_FILE, frame_path

SCENE = '[scene]\nname = "made-up"\n[box]\nsize = [1.0, 0.5]\n'


def a_frame(index: int, dimension: int = 2, count: int = 50) -> dict:
    rng = np.random.default_rng(index)
    return frame_tree(
        groups={
            "particles": {
                "positions": rng.random((count, dimension)),
                "velocities": rng.random((count, dimension)),
                "volumes": rng.random(count),
            },
            "grid": {
                "node_ids": np.arange(2**dimension),
                "positions": rng.random((2**dimension, dimension)),
                "velocities": rng.random((2**dimension, dimension)),
                "cells": np.arange(2**dimension, dtype=np.int32)[None],
                "stresses": rng.random((2**dimension, 3 * dimension - 3)),
            },
        },
        steps={"time": 0.1 * index - np.array([0.05, 0.0]), "sweeps": np.array([index, 7])} if index else {},
        observables={"time": 0.1 * index, "front": 1.0 + index},
    )


def fill(store: FolderStore | MemoryStore, frames: int, dimension: int = 2) -> None:
    for index in range(frames):
        store.put_frame(index, a_frame(index, dimension))
        store.put_checkpoint({"frame": np.int64(index)})


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class TestSealedFiles:
    def test_a_sealed_tree_comes_back_exactly(self, tmp_path: Path) -> None:
        tree = {"a": np.arange(1000.0), "inner": {"n": np.int64(3), "empty": np.zeros((0, 2))}}
        write_sealed(tmp_path / "file.h5", tree)
        back = read_sealed(tmp_path / "file.h5")
        assert np.array_equal(back["a"], tree["a"])
        assert back["inner"]["n"] == 3
        assert back["inner"]["empty"].shape == (0, 2)

    def test_the_same_tree_gives_the_same_bytes_at_any_time(self) -> None:
        first = seal(a_frame(1))
        time.sleep(1.1)  # HDF5 time stamps count seconds
        assert seal(a_frame(1)) == first

    def test_any_other_tool_can_open_a_sealed_file(self, tmp_path: Path) -> None:
        write_sealed(tmp_path / "file.h5", {"a": np.arange(5)})
        with h5py.File(tmp_path / "file.h5", "r") as file:
            assert list(file["a"]) == [0, 1, 2, 3, 4]

    @given(place=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
    def test_every_altered_byte_that_matters_is_found(
        self, place: float, flip: int, tmp_path_factory
    ) -> None:
        path = tmp_path_factory.mktemp("sealed") / "file.h5"
        image = bytearray(seal(a_frame(1)))
        head = 17 + 32  # magic and digest; the rest of the user block is padding
        at = int(place * (len(image) - 512 + head))
        image[at if at < head else at - head + 512] ^= flip
        path.write_bytes(image)
        with pytest.raises(InputError, match=r"file\.h5 = truncated, altered or foreign"):
            read_sealed(path)

    @given(share=st.floats(0.0, 1.0, exclude_max=True))
    def test_a_truncated_file_is_found(self, share: float, tmp_path_factory) -> None:
        path = tmp_path_factory.mktemp("sealed") / "file.h5"
        image = seal(a_frame(1))
        path.write_bytes(image[: int(share * len(image))])
        with pytest.raises(InputError, match=r"file\.h5"):
            read_sealed(path)


class TestRunFolder:
    def test_a_new_folder_gets_its_scene(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path / "deep" / "run", SCENE) as store:
            assert store.path("scene.toml").read_text() == SCENE
            assert store.checkpoint() is None

    def test_a_foreign_folder_is_refused_and_untouched(self, tmp_path: Path) -> None:
        (tmp_path / "thesis.tex").write_text("years of work")
        before = snapshot(tmp_path)
        for resume in (False, True):
            with pytest.raises(InputError, match="nothing was touched"):
                claim_folder(tmp_path, SCENE, resume)
        assert snapshot(tmp_path) == before

    def test_a_run_folder_needs_resume(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 2)
        before = snapshot(tmp_path)
        with pytest.raises(InputError, match="--resume"):
            claim_folder(tmp_path, SCENE)
        assert snapshot(tmp_path) == before
        with claim_folder(tmp_path, SCENE, resume=True) as store:
            assert store.checkpoint() == {"frame": 1}
        assert snapshot(tmp_path) == before

    def test_resuming_another_scene_names_the_first_difference(self, tmp_path: Path) -> None:
        claim_folder(tmp_path, SCENE).close()
        before = snapshot(tmp_path)
        with pytest.raises(InputError, match=r"box\.size = \[2\.0, 0\.5\]: must be \[1\.0, 0\.5\]"):
            claim_folder(tmp_path, SCENE.replace("[1.0,", "[2.0,"), resume=True)
        with pytest.raises(InputError, match=r"scene\.gravity"):
            claim_folder(tmp_path, SCENE.replace("[box]", "gravity = 1.6\n[box]"), resume=True)
        assert snapshot(tmp_path) == before

    def test_a_damaged_scene_file_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "scene.toml").write_text("not = = toml")
        with pytest.raises(InputError, match=r"scene\.toml = not TOML"):
            claim_folder(tmp_path, SCENE, resume=True)

    def test_two_runs_cannot_share_a_folder(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE), pytest.raises(InputError, match="no other barchan process"):
            claim_folder(tmp_path, SCENE, resume=True)
        claim_folder(tmp_path, SCENE, resume=True).close()

    @pytest.mark.parametrize("place", ["file", "file/below"])
    def test_a_place_that_cannot_be_a_folder(self, tmp_path: Path, place: str) -> None:
        (tmp_path / "file").write_text("x")
        with pytest.raises(InputError, match="folder"):
            claim_folder(tmp_path / place, SCENE)
        assert snapshot(tmp_path) == {"file": b"x"}

    @pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc refuses everybody on Linux only")
    def test_a_place_the_system_refuses(self) -> None:
        with pytest.raises(InputError, match="not writable"):
            claim_folder("/proc/barchan/run", SCENE)

    def test_a_folder_left_by_a_process_killed_in_its_first_write_is_new(self, tmp_path: Path) -> None:
        (tmp_path / "scene.toml.barchan-partial").write_text("[sce")
        claim_folder(tmp_path, SCENE).close()
        assert list(snapshot(tmp_path)) == ["scene.toml"]

    def test_a_lost_checkpoint_is_named(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 3)
            store.path(CHECKPOINT_FILE).unlink()
            with pytest.raises(InputError, match=r"checkpoint\.h5"):
                store.checkpoint()


class TestAssembly:
    @pytest.mark.parametrize("dimension", [2, 3])
    def test_memory_frame_files_and_results_file_read_the_same(self, tmp_path: Path, dimension: int) -> None:
        memory = MemoryStore()
        fill(memory, 4, dimension)
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 4, dimension)
            under_way = results.open(tmp_path)
            assert (under_way.frames, under_way.finished) == (4, False)
            frames = [(under_way.particles(k), under_way.grid(k)) for k in range(4)]
            tables = under_way.steps, under_way.observables
            assemble(store, 4, SCENE, store.results_path)
            store.discard_work_files()
        finished = results.open(tmp_path)
        assert (finished.frames, finished.finished) == (4, True)
        for other in (finished, results_in_memory(memory, SCENE)):
            for k, (particles, grid) in enumerate(frames):
                assert particles["positions"].shape == (50, dimension)
                np.testing.assert_equal(other.particles(k), particles)
                np.testing.assert_equal(other.grid(k), grid)
            np.testing.assert_equal((other.steps, other.observables), tables)
        assert finished.scene["scene"]["name"] == "made-up"
        assert finished.times == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert list(finished.steps["sweeps"]) == [1, 7, 2, 7, 3, 7]
        assert not (tmp_path / "frames").exists()

    def test_the_results_file_does_not_depend_on_when_it_was_written(self, tmp_path: Path) -> None:
        images = []
        for name in ("now", "later"):
            with claim_folder(tmp_path / name, SCENE) as store:
                fill(store, 3)
                assemble(store, 3, SCENE, store.results_path)
                images.append(store.results_path.read_bytes())
            time.sleep(1.1)
        assert images[0] == images[1]

    def test_a_damaged_frame_is_named_and_no_results_are_written(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 3)
            path = frame_path(tmp_path, 1)
            path.write_bytes(path.read_bytes()[:-1])
            before = snapshot(tmp_path)
            with pytest.raises(InputError, match=r"frame_00001\.h5"):
                assemble(store, 3, SCENE, store.results_path)
            with pytest.raises(InputError, match=r"frame_00003\.h5"):
                store.frame_image(3)
        assert snapshot(tmp_path) == before

    def test_fields_are_single_precision_and_volumes_double(self) -> None:
        tree = unseal(seal(a_frame(2)))
        assert tree["particles"]["positions"].dtype == np.float32
        assert tree["particles"]["volumes"].dtype == np.float64
        assert np.array_equal(tree["particles"]["positions"][:, 2], np.zeros(50))


class TestReading:
    def test_what_is_not_a_run_folder(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"scene\.toml"):
            results.open(tmp_path)
        (tmp_path / "scene.toml").write_text(SCENE)
        with pytest.raises(InputError, match="first frame"):
            results.open(tmp_path)

    @pytest.mark.parametrize("content", [b"", b"not HDF5 at all", b"\x89HDF\r\n\x1a\n" + 200 * b"\0"])
    def test_a_damaged_results_file_is_named(self, tmp_path: Path, content: bytes) -> None:
        (tmp_path / "scene.toml").write_text(SCENE)
        (tmp_path / RESULTS_FILE).write_bytes(content)
        with pytest.raises(InputError, match=r"results\.h5"):
            results.open(tmp_path)

    def test_a_foreign_hdf5_file_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "scene.toml").write_text(SCENE)
        with h5py.File(tmp_path / RESULTS_FILE, "w") as file:
            file["x"] = 1
        with pytest.raises(InputError, match="barchan results 1"):
            results.open(tmp_path)

    def test_frames_count_from_the_end_too_and_stay_in_range(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 3)
        opened = results.open(tmp_path)
        np.testing.assert_equal(opened.particles(-1), opened.particles(2))
        for frame in (3, -4):
            with pytest.raises(InputError, match="frame"):
                opened.particles(frame)

    def test_a_damaged_summary_is_named(self, tmp_path: Path) -> None:
        with claim_folder(tmp_path, SCENE) as store:
            fill(store, 1)
        opened = results.open(tmp_path)
        assert opened.summary == {}
        (tmp_path / "summary.json").write_text(json.dumps({"front": 1.0}))
        assert opened.summary == {"front": 1.0}
        (tmp_path / "summary.json").write_text('{"front": ')
        with pytest.raises(InputError, match=r"summary\.json"):
            _ = opened.summary
