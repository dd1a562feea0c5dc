"""Scenes of grains inside a fluid: what files may say, how matter starts, and laws that short runs must obey."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan import results, scenes
from barchan.errors import InputError
from barchan.results.stored_meshes import mesh_from, mesh_group
from barchan.scenes.kinds.suspension import observables as observed
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.scenes.kinds.suspension.profiles import at_rest
from barchan.scenes.validation import validate

TABLES: dict[str, Any] = {
    "scene": {"name": "small", "kind": "suspension"},
    "box": {"size": [0.4, 0.4], "cells": [8, 8]},
    "grains": {"density": 2500.0, "diameter": 1e-4},
    "matter": {"sand": {"position": [0.2, 0.15], "size": [0.4, 0.3], "packing": 0.3}},
    "sides": {"z_min": "slip"},
    "time": {"end": 0.04, "frame_rate": 25.0, "step": 0.02},
    "particles": {"per_cell": 2},
}

BALL: dict[str, Any] = {"position": [0.2, 0.1], "shape": "sphere", "radius": 0.1}


def tables_with(**changes: Any) -> dict[str, Any]:
    """The tables above, with `table={key: value}` changed."""
    tables = {name: dict(content) for name, content in TABLES.items()}
    for name, content in changes.items():
        tables[name] = {**tables.get(name, {}), **content}
    return tables


def small(**changes: Any) -> SuspensionParameters:
    parameters = validate(tables_with(**changes))
    assert isinstance(parameters, SuspensionParameters)
    return parameters


def model_of(**changes: Any) -> Any:
    return scenes.Scene(small(**changes)).model()


class TestBadInput:
    @pytest.mark.parametrize(
        ("changes", "field"),
        [
            ({"grains": {"max_volume_fraction": 1.0}}, "grains.max_volume_fraction"),
            ({"grains": {"diameter": 0.0}}, "grains.diameter"),
            ({"grains": {"friction": -0.1}}, "grains.friction"),
            ({"fluid": {"viscosity": -1e-3}}, "fluid.viscosity"),
            ({"fluid": {"density": 0.0}}, "fluid.density"),
            ({"matter": {"sand": {"position": [0.2], "size": [0.4, 0.3]}}}, "matter.sand.position"),
            ({"matter": {"sand": {"position": [0.2, 0.1], "size": [0.4, 0.2], "packing": 1.2}}}, "matter.sand.packing"),
            ({"matter": {"sand": {**BALL, "ripple": 0.1}}}, "matter.sand.ripple"),
            ({"matter": {"sand": {"position": [0.2, 0.1], "size": [0.4, 0.2], "ripple": 0.3}}}, "matter.sand.ripple"),
            ({"observe": {"length": 0.1}}, "observe.height"),
            ({"sides": {"y_min": "slip"}}, "sides.y_min"),
            ({"solver": {"model": "one_phase"}}, "solver.model"),
            ({"time": {"fluid_cfl": 0.0}}, "time.fluid_cfl"),
        ],
    )  # fmt: skip
    def test_files_that_cannot_be_are_refused_by_key(self, changes: dict[str, Any], field: str) -> None:
        with pytest.raises(InputError) as caught:
            small(**changes)
        assert caught.value.field == field

    @pytest.mark.parametrize(
        ("changes", "field"),
        [
            ({"grains": {"diameter": 0.06}}, "grains.diameter"),  # wider than a cell
            ({"sides": {"x_min": {"kind": "slip", "velocity": [0.1, 0.0]}}}, "sides"),  # fills a closed box
            ({"sides": {"x_min": {"velocity": [0.0, 0.1, 0.0]}}}, "sides.x_min.velocity"),
            ({"sides": {"x_min": {"kind": "slip", "friction": 0.2}}}, "sides.x_min.friction"),
            ({"drag": {"law": "carman_kozeny", "exponent": 4.0}}, "drag.exponent"),
            ({"viscosity": {"law": "einstein", "exponent": 4.0}}, "viscosity.exponent"),
            ({"drag": {"law": "quadratic"}, "solver": {"model": "darcy"}}, "drag.law"),
            ({"solver": {"method": "magic"}}, "solver.method"),
            ({"solver": {"penalty": 1e-6}}, "solver.penalty"),
        ],
    )
    def test_what_the_flow_refuses_is_named_as_in_the_file(self, changes: dict[str, Any], field: str) -> None:
        with pytest.raises(InputError) as caught:
            model_of(**changes)
        assert caught.value.field.startswith(field)

    def test_matter_outside_of_the_box_is_refused(self) -> None:
        model = model_of(matter={"sand": {"position": [0.2, 0.3], "size": [0.4, 0.3]}})
        with pytest.raises(InputError, match=r"matter\.sand"):
            model.initial()

    def test_light_grains_are_announced(self) -> None:
        with pytest.warns(UserWarning, match="rise"):
            model_of(grains={"density": 500.0})

    @pytest.mark.parametrize(
        "scene", ["sedimentation", "rayleigh_taylor", "immersed_column", "avalanche_underwater"]
    )
    def test_presets_suit_their_grids(self, scene: str) -> None:
        parameters = scenes.load(scene).parameters
        assert isinstance(parameters, SuspensionParameters)
        assert parameters.grains.diameter <= min(parameters.spacing)
        assert all(count % 2 == 0 for count in parameters.box.cells)

    def test_a_written_scene_keeps_its_faces_and_closures(self, tmp_path: Path) -> None:
        sides = {"z_max": {"velocity": [0.1, 0.0]}, "x_min": {"friction": 0.3}}
        scene = scenes.Scene(small(sides=sides, drag={"law": "quadratic", "coefficient": 0.5}))
        (tmp_path / "again.toml").write_text(scene.toml())
        assert scenes.load(tmp_path / "again.toml").parameters == scene.parameters
        assert tomllib.loads(scene.toml())["sides"]["x_min"] == {"friction": 0.3}


class TestMatter:
    @given(
        amplitude=st.floats(-0.03, 0.03), half_waves=st.integers(1, 4), face=st.sampled_from(["top", "bottom"]),
        packing=st.floats(0.1, 1.0),
    )  # fmt: skip
    @settings(max_examples=20, deadline=None)
    def test_a_wave_is_measured_as_it_was_given_and_adds_no_matter(
        self, amplitude: float, half_waves: int, face: str, packing: float
    ) -> None:
        piece = {
            "position": [0.2, 0.2], "size": [0.4, 0.2], "packing": packing, "ripple": amplitude,
            "half_waves": half_waves, "rippled": face,
        }  # fmt: skip
        parameters = small(
            matter={"sand": piece},
            observe={"half_waves": half_waves},
            box={"size": [0.4, 0.4], "cells": [24, 8]},
        )
        grains = scenes.Scene(parameters).model().initial().grains
        found = observed.ripple_amplitude(parameters, grains.positions, grains.volumes)
        assert found == pytest.approx(amplitude, abs=1e-3 * abs(amplitude) + 1e-15)
        assert grains.volumes.sum() == pytest.approx(0.4 * 0.2 * 0.6 * packing, rel=1e-12)

    def test_grains_start_at_their_volume_fraction(self) -> None:
        model = model_of()
        state = model.initial()
        fractions = model.flow.volume_fractions(state).reshape(9, 9)
        np.testing.assert_allclose(fractions[:, :5], 0.18, rtol=1e-12)
        assert not fractions[:, 8].any()

    def test_scattered_grains_stay_in_their_piece_and_repeat(self) -> None:
        piece = {**TABLES["matter"]["sand"], "scatter": 1.0}
        first, second = (model_of(matter={"sand": piece}).initial().grains for _ in range(2))
        np.testing.assert_array_equal(first.positions, second.positions)
        regular = model_of().initial().grains.positions
        moved = np.abs(first.positions - regular)
        assert 0.0 < moved.max() <= 0.5 * 0.05 / 2
        assert np.all(first.positions >= 0.0) and first.positions[:, 1].max() <= 0.3


class TestMeasures:
    def test_the_packed_bed_carries_the_buoyant_weight_of_all_grains(self) -> None:
        parameters = small()
        z = (np.arange(400) + 0.5) * 1e-3
        theory = at_rest(parameters, {"profile_z": z}, volume=0.4 * 0.1 * 0.6)
        weight = 1500.0 * 9.81 * 0.1 * 0.6
        assert np.interp(0.0, z, theory["profile_vertical_stress"]) == pytest.approx(weight, rel=0.01)
        assert theory["profile_pressure"][0] == pytest.approx(9810.0 * 0.4, rel=0.01)
        assert np.trapezoid(theory["profile_fraction"], z) == pytest.approx(0.06, rel=0.02)

    def test_the_settling_time_of_an_exponential_is_known(self) -> None:
        times = np.linspace(0.0, 20.0, 2001)
        found = observed.settling_time(times, np.exp(-times), 0.01)
        assert found == pytest.approx(np.log(100.0), abs=0.02)
        assert observed.settling_time(times, 20.0 - times, 0.01) is None  # still falling
        assert observed.settling_time(times, times, 0.01) is None  # never fell

    def test_hexahedra_are_stored_in_the_order_of_vtk_and_come_back(self) -> None:
        model = model_of(
            box={"size": [0.4, 0.2, 0.4], "cells": [2, 2, 2]},
            matter={"sand": {"position": [0.2, 0.1, 0.1], "size": [0.4, 0.2, 0.2]}},
        )
        group = model.frame(model.initial())["mesh"]
        corners = group["positions"][group["cells"]]
        np.testing.assert_allclose(corners[:, 6] - corners[:, 0], [[0.2, 0.1, 0.2]] * 8)  # opposite corners
        mesh = mesh_from(group)
        again = mesh_group(mesh)
        np.testing.assert_array_equal(again["cells"], group["cells"])
        volume = np.abs(np.linalg.det(mesh.mapping().DF(np.full((3, 1), 0.5))[..., 0].transpose(2, 0, 1)))
        assert volume.sum() == pytest.approx(0.4 * 0.2 * 0.4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> scenes.Run:
    folder = tmp_path_factory.mktemp("suspension") / "run"
    time = {"end": 0.4, "frame_rate": 10.0, "step": 0.02}
    changes = {"time": time, "observe": {"length": 0.4, "height": 0.3}}
    return scenes.Scene(small(**changes)).run(folder, progress=False)


class TestRuns:
    def test_a_run_leaves_pictures_and_fields_of_both_phases(self, run: scenes.Run) -> None:
        assert run.folder is not None
        names = {path.name for path in (run.folder / "pictures").iterdir()}
        assert names == {"phases.png", "layers.png", "curves.png", "profile.png", "suspension.gif"}
        assert (run.folder / "fields.vtu").exists() and (run.folder / "results.xdmf").exists()
        stored = results.open(run.folder)
        assert stored.fields(-1)["velocities"].shape == (81, 2)
        assert stored.lines(-1)["profile_z"].shape == (8,)
        assert len(stored.mesh["cells"]) == 64

    def test_matter_is_kept_and_energy_falls(self, run: scenes.Run) -> None:
        summary = run.summary
        assert summary["converged"] and summary["volume_drift"] < 1e-12
        assert summary["largest_divergence"] < 1e-6
        assert summary["energy_drop"] > 0.0 and summary["largest_energy_rise"] < 1e-12
        assert np.all(np.diff(run.observables["centre_z"]) < 0.0)

    def test_settling_grains_press_on_the_water(self, run: scenes.Run) -> None:
        """Until contacts bear them, the pore pressure bears the whole weight of the mixture."""
        lines = run.results.lines(1)
        weight = lines["profile_weight"][0] + lines["profile_vertical_stress"][0]
        excess = lines["profile_pressure"][0] - 9810.0 * (0.4 - lines["profile_z"][0])
        assert excess == pytest.approx(weight, rel=0.03)

    def test_the_summary_has_the_numbers_of_the_mixture(self, run: scenes.Run) -> None:
        assert run.summary["relative_density_excess"] == pytest.approx(1.5)
        assert run.summary["grain_size_over_length"] == pytest.approx(1e-4 / 0.3)

    def test_resuming_from_a_checkpoint_repeats_the_bits(self) -> None:
        model = model_of()
        state, _ = model.advance(model.initial(), 0.02)
        straight, _ = model.advance(state, 0.02)
        resumed, _ = model.advance(model.restore(model.arrays(state)), 0.02)
        for name, array in model.arrays(straight).items():
            np.testing.assert_array_equal(array, model.arrays(resumed)[name], err_msg=name)

    def test_steps_shorten_for_fast_grains_and_fast_fluid(self) -> None:
        model = model_of(matter={"sand": {**TABLES["matter"]["sand"], "velocity": [5.0, 0.0]}})
        assert model.longest_step(model.initial()) == pytest.approx(0.05 / 5.0)
        still = model_of()
        assert still.longest_step(still.initial()) == 0.02

    def test_in_space_a_picture_shows_the_solid(self, tmp_path: Path) -> None:
        scene = scenes.Scene(
            small(
                box={"size": [0.4, 0.2, 0.4], "cells": [4, 2, 4]},
                matter={"sand": {"position": [0.1, 0.1, 0.1], "size": [0.2, 0.2, 0.2]}},
            )
        )
        run = scene.run(tmp_path / "run", progress=False)
        assert run.folder is not None and (run.folder / "pictures" / "solid.png").exists()
        assert run.summary["converged"]
