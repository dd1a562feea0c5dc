"""The examples of docs/soft_spheres.md and docs/coarse_graining.md run and do what the pages say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from barchan.bodies import coarse_graining, soft

DOCS = Path(__file__).resolve().parents[2] / "docs"


def run_example(page: str) -> dict[str, object]:
    (example,) = re.findall(
        r"^```python\n(.*?)^```$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    names: dict[str, object] = {}
    exec(compile(example, page, "exec"), names)
    return names


def test_the_example_of_soft_spheres_pours_grains_that_lose_their_energy() -> None:
    energy = run_example("soft_spheres.md")["energy"]
    assert isinstance(energy, soft.Energy)
    assert energy.translation < 0.05 * energy.dissipated


def test_the_example_of_coarse_graining_gives_a_profile_that_bears_its_weight() -> None:
    names = run_example("coarse_graining.md")
    profile = names["profile"]
    assert isinstance(profile, coarse_graining.Fields)
    weight = np.sum(names["grains"].masses) / 8.0  # type: ignore[attr-defined]
    # the walls at the sides bear a part
    assert 0.4 * weight < np.max(profile.stress[:, 1, 1]) < weight
    assert np.sum(profile.density) * 0.1 < weight


@pytest.mark.parametrize(
    ("module", "page"), [(soft, "soft_spheres.md"), (coarse_graining, "coarse_graining.md")]
)
def test_what_people_call_is_on_the_page(module: object, page: str) -> None:
    text = "".join(
        (DOCS / name).read_text(encoding="utf-8") for name in ("soft_spheres.md", "coarse_graining.md")
    )
    helpers = {
        "CellState",
        "Collision",
        "Energy",
        "ShearAverage",
        "WALL",
        "Kernel",
        "VolumeMean",
        "Fields",
        "Periodic",
    }
    helpers |= {"share_beyond", "deviatoric_norm", "effective_friction", "inertial_number"}
    missing = [name for name in module.__all__ if name not in helpers and name not in text]  # type: ignore[attr-defined]
    assert missing == []
