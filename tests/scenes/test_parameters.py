"""Scene files: what is accepted comes back unchanged, what is wrong is named with its value and what is allowed."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan import scenes
from barchan.errors import InputError
from barchan.scenes.loading import parse_setting
from barchan.scenes.toml_text import to_toml
from barchan.scenes.validation import known_keys, validate

MINIMAL: dict[str, dict[str, Any]] = {
    "scene": {"name": "small"},
    "box": {"size": [1.0, 0.5], "cells": [20, 10]},
    "column": {"length": 0.2, "height": 0.3},
    "material": {"density": 1500.0, "friction": 0.5},
    "time": {"end": 1.0, "frame_rate": 10.0, "step": 0.01},
}

walls = st.sampled_from(["stick", "slip"]) | st.builds(lambda f: {"friction": f}, st.floats(0.0, 5.0))
positive = st.floats(1e-6, 1e6)


@st.composite
def scene_tables(draw: st.DrawFn) -> dict[str, dict[str, Any]]:
    """Tables of a valid scene."""
    d = draw(st.sampled_from([2, 3]))
    size = [draw(st.floats(0.1, 10.0)) for _ in range(d)]
    faces = ("x_min", "x_max", "z_min", "z_max") + (("y_min", "y_max") if d == 3 else ())
    return {
        "scene": {"name": draw(st.from_regex(r"\A[A-Za-z0-9_.-]{1,20}\Z")), "description": draw(st.text())},
        "box": {"size": size, "cells": [draw(st.integers(1, 50)) for _ in range(d)]},
        "column": {
            "length": size[0] * draw(st.floats(0.1, 0.5)),
            "height": size[-1] * draw(st.floats(0.1, 1.0)),
            "position": size[0] * draw(st.floats(0.0, 0.4)),
        },
        "material": {
            "density": draw(positive),
            "friction": draw(st.floats(0.0, 2.0)),
            "viscosity": draw(st.floats(0.0, 1e3)),
            "max_volume_fraction": draw(st.floats(0.1, 1.0)),
        },
        "walls": {face: draw(walls) for face in faces if draw(st.booleans())},
        "time": {
            "end": draw(st.floats(0.1, 10.0)),
            "frame_rate": draw(st.floats(1.0, 100.0)),
            "step": draw(st.floats(1e-4, 1.0)),
            "adaptive": draw(st.booleans()),
        },
    }


def changed(key: str, value: Any) -> dict[str, dict[str, Any]]:
    table, name = key.split(".")
    return {**MINIMAL, table: {**MINIMAL.get(table, {}), name: value}}


class TestWhatIsAccepted:
    @given(tables=scene_tables())
    def test_the_written_scene_is_complete_and_loads_as_the_same_scene(self, tables: dict) -> None:
        parameters = validate(tables)
        text = to_toml(parameters)
        again = tomllib.loads(text)
        assert validate(again) == parameters
        in_plane = {f"walls.{face}" for face in ("y_min", "y_max")} if parameters.dimension == 2 else set()
        written = {f"{table}.{key}" for table, content in again.items() for key in content}
        assert written == set(known_keys()) - in_plane

    @pytest.mark.parametrize("name", scenes.preset_names())
    def test_presets_load_and_hold_their_column(self, name: str) -> None:
        scene = scenes.load(name)
        assert scene.name == name
        assert scene.parameters.scene.description
        assert tomllib.loads(scene.toml())["scene"]["name"] == name

    def test_the_presets_have_the_published_parameters(self, shared_data: Path) -> None:
        text = (shared_data / "reference" / "mpm_scene_parameters.toml").read_text()
        published = tomllib.loads(re.sub("#.*", "", text).replace("; ", "\n"))  # entries end in semicolons
        gravel, laboratory = scenes.load("collapse").parameters, published["lab_columns"]["gravel"]
        assert (gravel.column.length, gravel.column.height) == (laboratory["length"], laboratory["height"])
        assert (gravel.material.density, gravel.material.friction) == (laboratory["rho"], laboratory["mu"])
        assert gravel.material.grain_diameter == laboratory["grain_diameter"]
        for name, key in (("collapse_2d", "collapse_2d"), ("collapse_3d", "collapse")):
            ours, theirs = scenes.load(name).parameters, published[key]
            assert ours.box.size == theirs["box"]
            assert ours.box.cells == theirs["grid"]
            steps_in_theirs = 1.0 / (theirs["rate"] * ours.time.step)  # a finer step serves as well
            assert steps_in_theirs == pytest.approx(max(1, round(steps_in_theirs)), rel=1e-12)
            material = ours.material
            given = (material.density, material.viscosity, material.friction, material.friction_increment)
            assert given == (theirs["rho"], theirs["eta"], theirs["mu"], theirs["delta_mu"])

    def test_side_walls_slip_in_3d_unless_given(self) -> None:
        box = {"size": [1.0, 0.2, 0.5], "cells": [20, 4, 10]}
        solid = validate({**MINIMAL, "box": box, "walls": {"y_max": {"friction": 0.3}}})
        assert solid.walls.y_min == "slip"
        assert solid.walls.y_max.friction == 0.3  # type: ignore[union-attr]
        assert validate(MINIMAL).walls.y_min is None

    def test_whole_numbers_serve_as_real_ones(self) -> None:
        assert validate(changed("material.density", 1500)).material.density == 1500.0

    def test_the_last_frame_reaches_the_end_time(self) -> None:
        assert validate(changed("time.end", 0.7)).frame_count == 7
        assert validate(changed("time.end", 0.71)).frame_count == 8
        assert validate(changed("time.end", 1e-9)).frame_count == 1


WRONG = [
    ("material.friction", -0.1, r"material\.friction = -0\.1: must be a finite number >= 0"),
    ("material.friction", math.nan, r"material\.friction = nan: must be a finite number"),
    ("material.density", 0.0, r"material\.density = 0\.0: must be a finite number > 0"),
    ("material.density", math.inf, r"material\.density = inf: must be a finite number > 0"),
    ("material.density", "heavy", r"material\.density = heavy: must be a finite number > 0"),
    ("material.density", True, r"material\.density = True: must be a finite number > 0"),
    ("material.max_volume_fraction", 1.2, r"max_volume_fraction = 1\.2: must be .*> 0 and <= 1"),
    ("material.grain_diameter", -1e-3, r"material\.grain_diameter = -0\.001"),
    ("material.frction", 0.5, r"material\.frction = 0\.5: .*nearest: friction\)"),
    ("matter.friction", 0.5, r"matter = .*nearest: material\)"),
    ("box.cells", [0, 10], r"box\.cells\[0\] = 0: must be 2 or 3 whole numbers >= 1"),
    ("box.cells", [20.5, 10], r"box\.cells\[0\] = 20\.5: must be .*whole"),
    ("box.cells", [20, 10, 5], r"box\.cells = \[20, 10, 5\]: must be 2 numbers"),
    ("box.cells", [], r"box\.cells = \[\]"),
    ("box.size", [1.0], r"box\.size = \[1\.0\]: must be 2 or 3"),
    ("box.size", [1.0, -0.5], r"box\.size\[1\] = -0\.5: must be .*> 0"),
    ("box.size", "large", r"box\.size = large"),
    ("column.length", 1.5, r"column\.length = 1\.5: must be at most 1 m"),
    ("column.height", 0.6, r"column\.height = 0\.6: must be at most 0\.5 m"),
    ("column.position", 0.9, r"column\.length = 0\.2: must be at most 0\.1 m"),
    ("column.position", 1.0, r"column\.position = 1\.0: must be less than the box length"),
    ("walls.z_min", "glue", r'walls\.z_min = glue: must be "stick", "slip" or'),
    ("walls.z_min", {"friction": -1.0}, r'walls\.z_min = .*must be "stick", "slip" or'),
    ("walls.z_min", {"friction": 0.3, "glue": 1}, r"walls\.z_min"),
    ("walls.y_min", "slip", r"walls\.y_min = slip: must be left out in 2D"),
    ("time.end", 0.0, r"time\.end = 0\.0: must be a finite number > 0"),
    ("time.frame_rate", 1e9, r"time\.frame_rate = 1000000000\.0: must be .*frames"),
    ("time.adaptive", "yes", r"time\.adaptive = yes: must be true or false"),
    ("solver.tolerance", 0.0, r"solver\.tolerance = 0\.0: must be a finite number > 0 and < 1"),
    ("solver.max_sweeps", 0, r"solver\.max_sweeps = 0: must be a whole number >= 1"),
    ("particles.per_cell", 2.5, r"particles\.per_cell = 2\.5: must be a whole number"),
    ("particles.transfer", "flip", r"particles\.transfer = flip: must be one of 'apic', 'pic'"),
    ("scene.kind", "sylo", r"scene\.kind = sylo: must be one of 'column', 'silo'"),
    ("scene.name", "a/b", r"scene\.name = a/b"),
]


class TestWhatIsRefused:
    @pytest.mark.parametrize(("key", "value", "message"), WRONG)
    def test_wrong_values_are_named_on_one_line(self, key: str, value: Any, message: str) -> None:
        with pytest.raises(InputError, match=message) as caught:
            validate(changed(key, value))
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("key", ["column.length", "box.size", "time.end", "scene.name"])
    def test_missing_keys_are_named(self, key: str) -> None:
        table, name = key.split(".")
        tables = {**MINIMAL, table: {k: v for k, v in MINIMAL[table].items() if k != name}}
        with pytest.raises(InputError, match=rf"{table}\.{name} = missing"):
            validate(tables)

    def test_missing_tables_are_named(self) -> None:
        with pytest.raises(InputError, match="column = missing"):
            validate({table: content for table, content in MINIMAL.items() if table != "column"})

    def test_a_value_in_the_place_of_a_table(self) -> None:
        with pytest.raises(InputError, match=r"material = 3: must be a table \[material\]"):
            validate({**MINIMAL, "material": 3})

    def test_scenes_that_do_not_exist(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"nearest: collapse_3d"):
            scenes.load("colapse_3d")
        with pytest.raises(InputError, match=r"nowhere\.toml = not readable"):
            scenes.load(tmp_path / "nowhere.toml")
        (tmp_path / "bad.toml").write_text("[scene\n")
        with pytest.raises(InputError, match=r"bad\.toml = not TOML"):
            scenes.load(tmp_path / "bad.toml")
        (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
        with pytest.raises(InputError, match=r"binary\.toml = not TOML"):
            scenes.load(tmp_path / "binary.toml")
        with pytest.raises(InputError, match="not readable"):
            scenes.load(tmp_path)


class TestOverrides:
    @pytest.mark.parametrize(
        "overrides",
        [
            {"friction": 0.7},
            {"material__friction": 0.7},
            {"material.friction": 0.7},
            {"material": {"friction": 0.7}},
            {"friction": np.float64(0.7)},
        ],
    )
    def test_every_way_to_name_a_parameter(self, overrides: dict[str, Any]) -> None:
        assert scenes.load("collapse", **overrides).parameters.material.friction == 0.7

    def test_arrays_and_tuples_serve_as_lists(self) -> None:
        scene = scenes.load("collapse", cells=np.array([80, 15]), size=(0.8, 0.15))
        assert scene.parameters.box.cells == [80, 15]

    def test_a_preset_is_not_changed_by_an_override(self) -> None:
        scenes.load("collapse", friction=0.7)
        assert scenes.load("collapse").parameters.material.friction == 0.65

    @pytest.mark.parametrize("key", ["frction", "material.frction", "material__frction"])
    def test_an_unknown_key_suggests_the_nearest(self, key: str) -> None:
        with pytest.raises(InputError, match=r"friction\)"):
            scenes.load("collapse", **{key: 0.7})

    def test_wrong_values_are_named_with_their_full_key(self) -> None:
        with pytest.raises(InputError, match=r"material\.friction = -1"):
            scenes.load("collapse", friction=-1)

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("material.friction=0.5", ("material.friction", 0.5)),
            ("box.cells=[10, 5]", ("box.cells", [10, 5])),
            ("walls.z_min=slip", ("walls.z_min", "slip")),
            ('walls.z_min="slip"', ("walls.z_min", "slip")),
            ("walls.z_min={friction = 0.5}", ("walls.z_min", {"friction": 0.5})),
            ("time.adaptive = false", ("time.adaptive", False)),
        ],
    )
    def test_settings_are_read_as_toml(self, text: str, expected: tuple[str, Any]) -> None:
        assert parse_setting(text) == expected

    @pytest.mark.parametrize("text", ["friction", "=0.5", ""])
    def test_settings_without_key_or_value(self, text: str) -> None:
        with pytest.raises(InputError, match="key=value"):
            parse_setting(text)
