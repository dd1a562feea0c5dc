"""Every kind of scene obeys the same rules: files, overrides, messages, storage, resuming to the same bytes."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from barchan import results, scenes
from barchan.errors import InputError
from barchan.results.stored_meshes import mesh_from
from barchan.scenes import finish
from barchan.scenes.continuum import ContinuumModel
from barchan.scenes.kinds import KIND_NAMES, find_kind
from barchan.scenes.toml_text import to_toml
from barchan.scenes.validation import known_keys, known_tables, validate
from barchan.spaces.meshes import rectangle, write_mesh

SMALL: dict[str, dict[str, Any]] = {
    "poiseuille_bingham": {"cells": 6, "length": 0.25},
    "bagnold": {"cells": 4},
    "cavity_bingham": {"cells": 6},
    "cylinder": {"vertices": 60, "tolerance": 1e-2},
    "silo": {"vertices": 60, "tolerance": 1e-2},
}
INERTIAL = {
    "regime": "inertial",
    "vertices": 60,
    "tolerance": 1e-2,
    "end": 0.9,
    "frame_rate": 10.0,
    "reynolds": 100.0,
}


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures have their own tests."""
    monkeypatch.setattr(finish, "draw_pictures", lambda *_: None)


@pytest.fixture
def mesh_scene(tmp_path: Path) -> Path:
    """A scene file of kind "dense" beside its mesh."""
    write_mesh(tmp_path / "box.msh", rectangle((0.0, 0.0), (1.0, 1.0), (3, 3)))
    path = tmp_path / "mine.toml"
    path.write_text(
        '[scene]\nname = "mine"\nkind = "dense"\ndimensionless = true\n[mesh]\nfile = "box.msh"\n'
        '[boundaries.left]\ntype = "no_slip"\n[boundaries.right]\ntype = "no_slip"\n'
        '[boundaries.top]\ntype = "velocity"\nvalue = ["free", -0.1]\n[material]\nmu = 0.3\n[solver]\ntolerance = 1e-3\n'
    )
    return path


class TestFiles:
    def test_every_kind_but_the_generic_one_comes_with_a_preset(self) -> None:
        kinds = {scenes.load(name).parameters.scene.kind for name in scenes.preset_names()}
        assert kinds == set(KIND_NAMES) - {"dense"}

    @pytest.mark.parametrize("name", scenes.preset_names())
    def test_the_written_scene_is_complete_and_loads_as_the_same_scene(
        self, name: str, tmp_path: Path
    ) -> None:
        parameters = scenes.load(name).parameters
        path = tmp_path / "again.toml"
        path.write_text(to_toml(parameters))
        assert scenes.load(path).parameters == parameters
        tables = tomllib.loads(path.read_text())
        assert list(tables) == list(known_tables(parameters.scene.kind))

    def test_a_scene_with_a_mesh_keeps_the_path_of_its_file_and_its_conditions(
        self, mesh_scene: Path, tmp_path: Path
    ) -> None:
        parameters = scenes.load(mesh_scene).parameters
        (tmp_path / "elsewhere").mkdir()
        copy = tmp_path / "elsewhere" / "scene.toml"
        copy.write_text(to_toml(parameters))
        assert scenes.load(copy).parameters == parameters
        assert tomllib.loads(copy.read_text())["mesh"]["file"] == str(tmp_path / "box.msh")

    @pytest.mark.parametrize("kind", KIND_NAMES)
    def test_a_table_that_is_left_out_means_what_an_empty_one_means(self, kind: str) -> None:
        for name, field in find_kind(kind).parameters.model_fields.items():
            if not field.is_required():
                assert field.get_default() == known_tables(kind)[name](), name

    @pytest.mark.parametrize("kind", KIND_NAMES)
    def test_every_key_says_what_it_means(self, kind: str) -> None:
        for group in known_tables(kind).values():
            assert all(field.description for field in (group.entries or group).model_fields.values())

    def test_dimensionless_scenes_say_so(self) -> None:
        text = scenes.load("silo").toml()
        assert "dimensionless = true" in text
        assert "SI units" not in text


class TestOverrides:
    @pytest.mark.parametrize(
        ("scene", "overrides"),
        [
            ("poiseuille_bingham", {"bingham": 0.1, "cells": 8, "velocity": "P3", "stress": "P2d"}),
            ("bagnold", {"mu": 0.3, "angle": 0.5, "cells": 8}),
            ("cavity_bingham", {"bingham": 5, "cells": 8}),
            ("cylinder", {"diameter": 0.2, "width": 1.0, "mu": 0.4, "reynolds": 10, "bingham": 0.1}),
            ("cylinder", {"external_pressure": 1.0, "sides": "no_slip"}),
            ("silo", {"mu": 0.5, "reynolds": 1, "bingham": 0, "outlet": 1.0, "vertices": 670}),
            (
                "silo",
                {"regime": "inertial", "mu_increment": 0.2, "inertial_reference": 0.3, "grain_diameter": 0.1},
            ),
            ("silo", {"width": 6.0, "height": 5.0, "below": 0.5, "wall": 0.3, "step": 0.05}),
        ],
    )
    def test_parameters_have_bare_names(self, scene: str, overrides: dict[str, Any]) -> None:
        parameters = scenes.load(scene, **overrides).parameters
        tables = parameters.model_dump()
        for key, value in overrides.items():
            (holder,) = (table for table in tables.values() if key in table)
            assert holder[key] == value

    def test_the_kind_decides_which_keys_there_are(self) -> None:
        assert "column.length" in known_keys() and "geometry.outlet" in known_keys("silo")
        with pytest.raises(InputError, match="outlet = 1"):
            scenes.load("cavity_bingham", outlet=1)
        with pytest.raises(InputError, match=r"column = .*tables are scene"):
            validate({"scene": {"name": "x", "kind": "silo"}, "column": {"length": 1.0}})

    def test_conditions_are_overridden_by_name(self, mesh_scene: Path) -> None:
        scene = scenes.load(mesh_scene, **{"boundaries.left": {"type": "friction", "friction": 0.2}})
        assert 'left = { type = "friction", friction = 0.2 }' in scene.toml()
        scene = scenes.load(mesh_scene, **{"boundaries.top.value": [0.0, -0.2]})
        assert "value = [0.0, -0.2]" in scene.toml()


class TestRuns:
    @pytest.mark.parametrize("name", SMALL)
    def test_a_steady_scene_leaves_start_and_solution(self, name: str, tmp_path: Path) -> None:
        run = scenes.load(name, **SMALL[name]).run(tmp_path / "run", progress=False)
        assert run.summary["ended"] == "steady" and run.summary["converged"]
        assert list(run.observables["time"]) == [0.0, 1.0]
        stored = results.open(tmp_path / "run")
        mesh, fields = stored.mesh, stored.fields(-1)
        count = len(mesh["positions"])
        assert fields["velocities"].shape == (count, 2)
        for scalar in ("pressures", "shear_stresses", "shear_rates", "plug"):
            assert fields[scalar].shape == (count,) and np.all(np.isfinite(fields[scalar]))
        assert np.all(fields["pressures"] >= -1e-6)  # no tension
        names = {path.name for path in (tmp_path / "run").iterdir()}
        assert names == {"results.h5", "results.xdmf", "fields.vtu", "scene.toml", "summary.json", "pictures"}
        assert "fields.png" in {path.name for path in (tmp_path / "run" / "pictures").iterdir()}

    def test_the_stored_mesh_is_the_mesh(self, no_pictures: None, tmp_path: Path) -> None:
        scene = scenes.load("silo", **SMALL["silo"])
        model = scene.model()
        assert isinstance(model, ContinuumModel)
        before = model.space.mesh
        after = mesh_from(scene.run(tmp_path / "run", progress=False).results.mesh)
        np.testing.assert_array_equal(after.p, before.p)
        np.testing.assert_array_equal(after.t, before.t)
        assert set(after.boundaries) == set(before.boundaries)
        for name in before.boundaries:
            assert set(after.boundaries[name]) == set(before.boundaries[name])

    def test_a_run_in_memory_gives_the_observables_of_one_in_a_folder(
        self, no_pictures: None, tmp_path: Path
    ) -> None:
        scene = scenes.load("poiseuille_bingham", **SMALL["poiseuille_bingham"])
        stored, kept = scene.run(tmp_path / "run", progress=False), scene.run(progress=False)
        np.testing.assert_equal(kept.observables, stored.observables)
        again = scene.run(tmp_path / "run", resume=True, progress=False)
        assert again.already_finished
        np.testing.assert_equal(again.observables, stored.observables)

    def test_an_interrupted_inertial_run_resumes_to_the_same_bytes(
        self, no_pictures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        scene = scenes.load("silo", **INERTIAL)
        whole = scene.run(tmp_path / "whole", progress=False)
        assert len(whole.observables["discharge"]) == 10
        advance = ContinuumModel.advance

        def advance_five(self: ContinuumModel, state: Any, dt: float) -> Any:
            if state.step == 5:
                raise KeyboardInterrupt
            return advance(self, state, dt)

        with monkeypatch.context() as patch:
            patch.setattr(ContinuumModel, "advance", advance_five)
            with pytest.raises(KeyboardInterrupt):
                scene.run(tmp_path / "parts", progress=False)
        scene.run(tmp_path / "parts", resume=True, progress=False)
        assert (tmp_path / "parts/results.h5").read_bytes() == (tmp_path / "whole/results.h5").read_bytes()
        with h5py.File(tmp_path / "whole/results.h5") as file:
            assert "mesh" in file and "mesh" not in file["frames/00000"]

    def test_an_inertial_flow_ends_when_it_is_steady(self) -> None:
        loose = {"steady_tolerance": 0.5, "steady_window": 0.2, "final_step": 0.1, "end": 3.0}
        run = scenes.load("silo", **{**INERTIAL, **loose}).run(progress=False)
        assert run.summary["ended"] == "steady"
        assert run.summary["end_time"] < 2.0
        assert run.observables["steady"][-1] == 1.0 and not run.observables["steady"][:-1].any()

    def test_a_flow_on_a_mesh_from_a_file_keeps_its_volume(self, no_pictures: None, mesh_scene: Path) -> None:
        run = scenes.load(mesh_scene).run(progress=False)
        inflow = -run.summary["outflow_top"]
        assert 0.0 < inflow <= 0.1 + 1e-9
        assert run.summary["outflow_bottom"] >= inflow - 1e-6  # matter may expand, not contract
        assert (
            run.summary["force_y_left"] < 0.0 or run.summary["force_y_right"] < 0.0
        )  # walls are dragged down

    def test_a_run_without_mesh_or_particles_says_what_it_has(self) -> None:
        run = scenes.load("cavity_bingham", **SMALL["cavity_bingham"]).run(progress=False)
        with pytest.raises(InputError, match="group = particles: must be one of"):
            run.results.particles(-1)
