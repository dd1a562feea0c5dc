"""Scene files of kind "sand": what is accepted comes back unchanged, what is wrong is named with what is allowed."""

from __future__ import annotations

import copy
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.errors import InputError
from barchan.scenes.kinds.sand.letters import pen_script, strokes_of, text_width
from barchan.scenes.kinds.sand.options import remarks
from barchan.scenes.toml_text import to_toml
from barchan.scenes.validation import validate

MINIMAL: dict[str, dict[str, Any]] = {
    "scene": {"name": "small", "kind": "sand"},
    "box": {"size": [1.0, 1.0, 0.5], "cells": [10, 10, 5]},
    "material": {"density": 1500.0, "friction": 0.5},
    "matter": {"bed": {"position": [0.5, 0.5, 0.1], "size": [1.0, 1.0, 0.2]}},
    "time": {"end": 1.0, "frame_rate": 10.0, "step": 0.01},
}
BALL = {"shape": "sphere", "radius": 0.1, "position": [0.5, 0.5, 0.35], "motion": "free", "density": 2000.0}
SAND = [name for name in scenes.preset_names() if scenes.load(name).parameters.scene.kind == "sand"]


def changed(**tables: dict[str, Any]) -> dict[str, dict[str, Any]]:
    base = copy.deepcopy(MINIMAL)
    for name, content in tables.items():
        base[name] = {**base.get(name, {}), **content}
    return base


def refused(tables: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        scenes.Scene(validate(tables)).model().initial()
    return str(caught.value)


class TestFiles:
    def test_all_scenes_of_the_chapter_are_there(self) -> None:
        wanted = {
            "collapse_anisotropic", "cylinder_collapse", "zb05", "silo_2d", "silo_3d", "hourglass", "wheel", "writing",
            "digging", "crater", "tower", "treasure", "lab_columns_beads",
        }  # fmt: skip
        assert wanted <= set(SAND)

    @pytest.mark.parametrize("name", SAND)
    def test_presets_have_the_published_material_and_box(self, name: str, shared_data: Path) -> None:
        text = (shared_data / "reference" / "mpm_scene_parameters.toml").read_text()
        published = tomllib.loads(re.sub("#.*", "", text).replace("; ", "\n"))
        theirs = published.get({"silo_3d": "silo"}.get(name, name))
        parameters = scenes.load(name).parameters
        if name == "lab_columns_beads":
            theirs = published["lab_columns"]["beads"]
            assert parameters.scene.slope_deg == theirs["slope_deg"]
            assert (parameters.observe.length, parameters.observe.height) == (
                theirs["length"],
                theirs["height"],
            )
            assert parameters.bodies.gate.velocity == [0.0, theirs["gate_speed"]]
        if theirs is None or "like" in theirs:
            return
        assert (parameters.material.density, parameters.material.friction) == (theirs["rho"], theirs["mu"])
        assert parameters.material.friction_increment == theirs.get("delta_mu", 0.0)
        # The empty upper part of the one is left out, the other is as wide for its outlet as the mesh-based silo.
        if "box" in theirs and name not in ("cylinder_collapse", "silo_2d"):
            assert parameters.box.size == theirs["box"]
        if "cohesion" in theirs:
            assert parameters.material.cohesion == theirs["cohesion"]
        if "ball_density" in theirs:
            assert parameters.bodies.ball.density == theirs["ball_density"]

    @pytest.mark.parametrize("name", SAND)
    def test_the_comment_of_a_preset_gives_settings_that_load(self, name: str) -> None:
        folder = Path(scenes.__file__).parent / "presets"
        comments = "\n".join(
            line.removeprefix("#")
            for line in (folder / f"{name}.toml").read_text().splitlines()
            if line.startswith("#")
        )
        settings = re.findall(r'--set (?:"([^"]+)"|(\S+=\S+))', comments)
        for quoted, bare in settings:
            text = quoted or bare
            if "..." not in text and "bunny" not in text:
                key, value = text.split("=", 1)
                scenes.load(
                    name,
                    **{
                        key.strip(): tomllib.loads(f"v = {value}")["v"]
                        if value[0] in "[0123456789tf"
                        else value
                    },
                )

    def test_side_walls_slip_unless_given(self) -> None:
        found = validate(changed(walls={"y_max": "open"}))
        assert (found.walls.y_min, found.walls.y_max) == ("slip", "open")  # type: ignore[attr-defined]

    def test_named_tables_are_overridden_by_name(self) -> None:
        scene = scenes.load("crater", **{"bodies.ball.radius": 0.05, "matter.bed.velocity": [0.0, 0.0, 1.0]})
        assert scene.parameters.bodies.ball.radius == 0.05
        again = validate(tomllib.loads(to_toml(scene.parameters)))
        assert again == scene.parameters

    def test_mesh_files_are_taken_from_the_folder_of_the_scene(self, tmp_path: Path) -> None:
        tables = changed(
            bodies={"thing": {"shape": "mesh", "file": "thing.ply", "position": [0.5, 0.5, 0.3]}}
        )
        path = tmp_path / "mine.toml"
        path.write_text(to_toml(validate(tables)))
        body = scenes.load(path).parameters.bodies.thing
        assert body.file == str(tmp_path / "thing.ply")

    def test_a_sloping_floor_turns_gravity_towards_x(self) -> None:
        gravity = validate(changed(scene={"slope_deg": 30.0})).gravity_vector  # type: ignore[attr-defined]
        assert gravity == pytest.approx([9.81 / 2.0, 0.0, -9.81 * np.sqrt(0.75)])


class TestWhatIsRefused:
    def test_a_material_that_is_not_there(self) -> None:
        assert "matter.bed.material = gold" in refused(
            changed(matter={"bed": {**MINIMAL["matter"]["bed"], "material": "gold"}})
        )

    def test_no_matter(self) -> None:
        tables = copy.deepcopy(MINIMAL)
        tables["matter"] = {}
        assert "matter = empty" in refused(tables)

    @pytest.mark.parametrize(
        ("table", "message"),
        [
            ({"shape": "sphere"}, "matter.bed.radius = missing"),
            ({"position": [0.5, 0.1]}, r"matter.bed.position = [0.5, 0.1]: must be 3 numbers"),
            ({"position": [0.5, 0.5, 0.6]}, "inside the box"),
            ({"size": None, "shape": "box"}, "matter.bed.size = missing"),
        ],
    )
    def test_pieces_of_matter_without_a_place(self, table: dict[str, Any], message: str) -> None:
        piece = {k: v for k, v in {**MINIMAL["matter"]["bed"], **table}.items() if v is not None}
        assert message in refused(changed(matter={"bed": piece}))

    @pytest.mark.parametrize(
        ("table", "message"),
        [
            ({"radius": None}, "bodies.ball.radius = missing"),
            ({"density": None}, "bodies.ball.density = None: must be given for a free body"),
            ({"mass": 1.0}, "bodies.ball.density"),
            ({"shape": "polygon"}, "bodies.ball.points"),
            ({"shape": "mesh"}, "bodies.ball.file"),
            ({"position": [0.5, 0.5, 2.0]}, "box"),
            ({"position": None}, "bodies.ball.position = missing"),
            ({"held": ["w"]}, "bodies.ball.held"),
            ({"motion": "scripted"}, "bodies.ball.times = missing"),
            ({"motion": "driven", "start": 2.0, "stop": 1.0}, "bodies.ball.stop"),
            ({"motion": "writing", "text": "A"}, "bodies.ball.letter_height = missing"),
            ({"shape": "plate_with_hole", "size": [0.5, 0.5, 0.1], "hole": 0.6}, "bodies.ball.hole"),
            ({"rotation": [1.0]}, "bodies.ball.rotation"),
        ],
    )
    def test_bodies_that_cannot_be(self, table: dict[str, Any], message: str) -> None:
        ball = {key: value for key, value in {**BALL, **table}.items() if value is not None}
        assert message in refused(changed(bodies={"ball": ball}))

    def test_overlapping_bodies(self) -> None:
        other = {**BALL, "position": [0.55, 0.5, 0.35]}
        assert "apart" in refused(changed(bodies={"ball": BALL, "other": other}))

    def test_an_open_mesh(self, tmp_path: Path) -> None:
        path = tmp_path / "open.obj"
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n")
        body = {"shape": "mesh", "file": str(path), "scale": 0.2, "position": [0.5, 0.5, 0.3]}
        assert "bodies.thing.mesh = 3 triangles: must be a closed mesh" in refused(
            changed(bodies={"thing": body})
        )

    def test_an_outlet_narrower_than_a_cell(self) -> None:
        plate = {
            "shape": "plate_with_hole",
            "size": [0.9, 0.9, 0.1],
            "hole": 0.05,
            "position": [0.5, 0.5, 0.3],
        }
        assert "at least one grid cell wide, 0.1 m" in refused(changed(bodies={"plate": plate}))

    def test_no_particles_in_a_cell(self) -> None:
        assert "particles.per_cell = 0" in refused(changed(particles={"per_cell": 0}))

    def test_splits_that_never_end(self) -> None:
        message = refused(changed(particles={"resample": True, "split_ratio": 1.2}))
        assert "particles.split_ratio = 1.2" in message and "never ends" in message

    @pytest.mark.parametrize(
        ("table", "message"),
        [
            ({"length": 0.2}, "observe.height = missing"),
            ({"until_share": 0.1}, "observe.level = missing"),
            ({"centre": [0.5]}, "observe.centre"),
        ],
    )
    def test_measures_that_lack_something(self, table: dict[str, Any], message: str) -> None:
        assert message in refused(changed(observe=table))

    def test_matter_wholly_inside_a_body(self) -> None:
        piece = {"shape": "sphere", "radius": 0.05, "position": [0.5, 0.5, 0.3]}
        block = {"shape": "box", "size": [0.4, 0.4, 0.3], "position": [0.5, 0.5, 0.3]}
        tables = copy.deepcopy(MINIMAL)
        tables["matter"], tables["bodies"] = {"lump": piece}, {"block": block}
        assert "not wholly inside a body" in refused(tables)

    def test_cohesion_that_the_stresses_cannot_hold_is_remarked_with_the_reason(self) -> None:
        tables = changed(material={"cohesion": 1e4})
        with pytest.warns(UserWarning, match="erodes from the surface"):
            scenes.Scene(validate(tables)).model()
        for choice in (
            {"material": {"cohesion": 1e4, "cohesion_decay": 1.0}},
            {"material": {"cohesion": 0.0}},
        ):
            assert remarks(validate(changed(**choice))) == []  # type: ignore[arg-type]
        held = changed(material={"cohesion": 1e4}, particles={"stress": "particles"})
        assert remarks(validate(held)) == []  # type: ignore[arg-type]


class TestLetters:
    def test_every_letter_fits_its_sheet(self) -> None:
        for letter in "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789":
            for stroke in strokes_of(letter, 6.0):
                assert len(stroke) >= 2
                assert np.all(stroke >= 0.0) and np.all(stroke <= [4.0, 6.0]), letter

    def test_a_text_is_as_wide_as_its_letters_and_gaps(self) -> None:
        corners = np.concatenate(strokes_of("LL", 0.6))
        assert corners[:, 0].max() == pytest.approx(text_width("LL", 0.6))

    def test_the_pen_moves_at_its_speed_and_is_up_between_strokes(self) -> None:
        times, points = pen_script(strokes_of("HI", 0.6), np.array([1.0, 2.0, 0.3]), 0.1, 0.5, 0.2)
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert lengths / np.diff(times) == pytest.approx(0.5)
        assert times[0] == 0.2
        assert points[0, 2] == points[-1, 2] == pytest.approx(0.4)
        level = points[1:, 2] == points[:-1, 2]
        drawn = level & (points[1:, 2] == 0.3)
        assert lengths[drawn].sum() == pytest.approx(
            sum(np.linalg.norm(np.diff(s, axis=0), axis=1).sum() for s in strokes_of("HI", 0.6))
        )

    @pytest.mark.parametrize("text", ["", "   ", "a+b"])
    def test_texts_without_letters_are_refused(self, text: str) -> None:
        with pytest.raises(InputError, match="text"):
            strokes_of(text, 1.0)
