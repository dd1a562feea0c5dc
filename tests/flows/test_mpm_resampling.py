"""Splits and merges conserve what they must, undo each other, and end."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.flows.mpm.frames import advected_frames, frame_volumes, initial_frames, semi_axes
from barchan.flows.mpm.orientation import evolved_orientations, friction_metric, metric_blocks
from barchan.flows.mpm.resampling import ENDLESS_RATIO, Resampling, resample

DIMENSIONS = [2, 3]
EAGER = Resampling(split_length=0.0, fewest_per_cell=1)


def cloud(d: int, count: int, seed: int, elongated: float = 1.0) -> dict[str, np.ndarray]:
    """Particles in the unit box whose frames have random axes and directions."""
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(count, d, d)))
    squares = (0.1 * np.exp(elongated * rng.normal(size=(count, d)))) ** 2
    return {
        "positions": rng.uniform(0.0, 1.0, (count, d)),
        "velocities": rng.normal(size=(count, d)),
        "affine": rng.normal(size=(count, d, d)),
        "volumes": rng.uniform(0.5, 1.5, count),
        "frames": np.einsum("pij,pj,pkj->pik", basis, squares, basis),
        "materials": rng.integers(0, 2, count).astype(np.int32),
        "cohesions": rng.uniform(size=count),
        "orientations": np.tile(np.eye(d) / d, (count, 1, 1)),
        "stresses": np.zeros((0, d * (d + 1) // 2)),
    }


def cells_of(fields: dict[str, np.ndarray], per_axis: int = 2) -> np.ndarray:
    index = np.clip((fields["positions"] * per_axis).astype(np.int64), 0, per_axis - 1)
    return np.ravel_multi_index(tuple(index.T), (per_axis,) * index.shape[1])


def first_moment(fields: dict[str, np.ndarray]) -> np.ndarray:
    """sum V (x - 1/2) (x) v and the part inside the bricks, sum V c F / 3: the linear part of the motion."""
    outer = np.einsum("p,pi,pj->ij", fields["volumes"], fields["velocities"], fields["positions"])
    inner = np.einsum("p,pij,pjk->ik", fields["volumes"], fields["affine"], fields["frames"]) / 3.0
    return outer + inner


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_volume_momentum_and_centre_of_mass_are_conserved(d, seed, elongated):
    before = cloud(d, 80, seed, elongated)
    after = resample(before, cells_of(before), EAGER, np.full(d, 0.5)).fields
    weights, new = before["volumes"], after["volumes"]
    assert np.sum(new) == pytest.approx(np.sum(weights), rel=1e-14)
    for name in ("positions", "velocities"):
        scale = np.sum(weights[:, None] * np.abs(before[name]))
        np.testing.assert_allclose(new @ after[name], weights @ before[name], atol=1e-14 * scale)
    np.testing.assert_allclose(
        np.sum(frame_volumes(after["frames"])), np.sum(frame_volumes(before["frames"])), rtol=1e-10
    )
    assert np.sum(new * after["cohesions"]) == pytest.approx(np.sum(weights * before["cohesions"]), rel=1e-13)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_resampling_conserves_the_moment_of_momentum(d):
    """sum V v (x) x with the affine parts: its skew part is the angular momentum of bricks in affine motion.

    Exact for splits; merged frames are scaled to conserve space, so merges are checked with the moments before that.
    """
    before = cloud(d, 60, 3)
    only_splits = Resampling(split_length=0.0, fewest_per_cell=1000, most_per_cell=1000)
    after = resample(before, cells_of(before), only_splits, np.full(d, 0.5))
    assert len(after.parents) > 60
    np.testing.assert_allclose(first_moment(after.fields), first_moment(before), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_split_fills_the_same_space_and_a_merge_undoes_it(d):
    before = cloud(d, 1, 0)
    widths = np.array([0.3, 0.1, 0.11][:d])
    before["frames"] = initial_frames([widths])
    before["positions"][:] = 0.5
    halves = resample(before, [0], EAGER, np.ones(d))
    assert halves.parents.tolist() == [0, 0] and halves.heirs.tolist() == [0]
    np.testing.assert_allclose(halves.fields["positions"][:, 0], [0.425, 0.575], rtol=1e-14)
    lengths, _ = semi_axes(halves.fields["frames"])
    np.testing.assert_allclose(np.sort(lengths[0]), np.sort(widths * [0.25, 0.5, 0.5][:d]), rtol=1e-12)
    np.testing.assert_array_equal(halves.fields["volumes"], 0.5 * np.repeat(before["volumes"], 2))
    again = Resampling(split_ratio=4.0, merge_ratio=3.5, split_length=0.0, fewest_per_cell=1, most_per_cell=1)
    whole = resample(halves.fields, [0, 0], again, np.ones(d))
    assert whole.parents.tolist() == [0] and whole.heirs.tolist() == [0, 0]
    for name in ("positions", "velocities", "affine", "volumes", "frames"):
        np.testing.assert_allclose(whole.fields[name], before[name], rtol=1e-12, atol=1e-15)


@given(st.sampled_from(DIMENSIONS), st.integers(0, 10_000), st.floats(1.0001 * ENDLESS_RATIO, 4.0))
@settings(max_examples=40, deadline=None)
def test_resampling_a_fixed_state_again_and_again_ends(d, seed, ratio):
    fields = cloud(d, 10, seed)
    options = Resampling(
        split_ratio=ratio, split_length=0.0, merge_ratio=1.3, most_per_cell=10**9, fewest_per_cell=1
    )
    for _ in range(100):
        count = len(fields["volumes"])
        after = resample(fields, cells_of(fields), options, np.full(d, 0.5))
        if len(after.parents) == count and np.array_equal(after.parents, np.arange(count)):
            break
        fields = after.fields
    else:
        pytest.fail("still splitting or merging")
    lengths, _ = semi_axes(fields["frames"])
    assert np.all(lengths[:, 0] <= ratio * lengths[:, -1] * (1 + 1e-12))


def test_endless_thresholds_are_refused_because_halves_stay_elongated():
    """The particle (1, 2^(1/3), 2^(2/3)) keeps its ratio when halved along its longest axis."""
    lengths = np.array([1.0, 2.0 ** (1 / 3), 2.0 ** (2 / 3)])
    halved = np.sort(lengths * [1.0, 1.0, 0.5])
    assert halved[2] / halved[0] == pytest.approx(lengths[2] / lengths[0]) == pytest.approx(ENDLESS_RATIO)
    for ratio in (0.5, 1.0, 1.5, ENDLESS_RATIO, float("nan")):
        with pytest.raises(InputError, match="never ends"):
            Resampling(split_ratio=ratio, merge_ratio=1.0)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_lattice_of_cubes_is_left_alone(d):
    axes = [(np.arange(6) + 0.5) / 6] * d
    fields = cloud(d, 6**d, 1)
    fields["positions"] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    fields["frames"] = initial_frames(np.full((6**d, d), 1 / 6))
    fields["materials"][:] = 0
    after = resample(fields, cells_of(fields), Resampling(fewest_per_cell=1), np.full(d, 0.5))
    assert np.array_equal(after.parents, np.arange(6**d))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_kneading_to_and_fro_does_not_multiply_the_particles(d):
    """Stretched to 2.5 times its length and back, twice: what stretching splits, shortening merges."""
    axes = [(np.arange(9) + 0.5) / 9 - 0.5] * d
    fields = cloud(d, 9**d, 1)
    fields["positions"] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    fields["frames"], fields["materials"] = (
        initial_frames(np.full((9**d, d), 1 / 9)),
        np.zeros(9**d, dtype=np.int32),
    )
    fields["volumes"][:] = 1.0
    counts, spacing = [], np.full(d, 1 / 3)
    for step in range(80):
        rates = (1.0 if step % 40 < 20 else -1.0) * np.array([1.0, -1.0, 0.0])[:d] * np.log(2.5) / 20
        fields["positions"] = fields["positions"] * np.exp(rates)
        count = len(fields["positions"])
        fields["affine"] = np.tile(np.diag(rates), (count, 1, 1))
        fields["velocities"] = fields["positions"] * rates
        fields["frames"] = advected_frames(fields["frames"], fields["affine"], 1.0)
        index = np.floor(fields["positions"] / spacing).astype(np.int64) + 50
        cells = np.ravel_multi_index(tuple(index.T), (100,) * d)
        fields = resample(fields, cells, Resampling(), spacing).fields
        counts.append(len(fields["volumes"]))
    assert max(counts) < 2.5 * 9**d and 0.4 * 9**d < counts[-1] < 1.6 * 9**d and min(counts) < counts[-2]
    assert np.sum(fields["volumes"]) == pytest.approx(9**d, rel=1e-13)
    np.testing.assert_allclose(fields["velocities"], fields["positions"] * rates, atol=1e-12)
    assert np.sum(frame_volumes(fields["frames"])) == pytest.approx(1.0, rel=1e-10)


def test_crowded_cells_are_thinned_but_not_below_the_fewest():
    fields = cloud(2, 200, 2, elongated=0.0)
    fields["positions"] = 0.4 + 0.1 * fields["positions"]
    options = Resampling(most_per_cell=40, fewest_per_cell=30)
    cells = np.zeros(200, dtype=np.int64)
    for _ in range(10):
        fields = resample(fields, cells, options, [1.0, 1.0]).fields
        cells = np.zeros(len(fields["volumes"]), dtype=np.int64)
    assert 30 <= len(cells) <= 60


@pytest.mark.parametrize("d", DIMENSIONS)
def test_materials_are_never_mixed_and_children_stay_in_the_box(d):
    before = cloud(d, 400, 7)
    per_material = np.bincount(before["materials"], before["volumes"])
    before["positions"][::7] = 1e-9
    after = resample(before, cells_of(before), EAGER, np.full(d, 0.5), np.zeros(d), np.ones(d))
    assert not np.array_equal(np.unique(after.heirs), np.arange(len(after.heirs)))
    np.testing.assert_allclose(
        np.bincount(after.fields["materials"], after.fields["volumes"]), per_material, rtol=1e-13
    )
    assert np.all((after.fields["positions"] >= 0.0) & (after.fields["positions"] <= 1.0))
    assert after.fields["stresses"].shape == before["stresses"].shape


def test_parents_and_heirs_tell_who_became_who():
    before = cloud(2, 300, 11)
    after = resample(before, cells_of(before, 4), EAGER, np.full(2, 0.25))
    rows = np.bincount(after.parents, minlength=300)
    assert set(rows) == {0, 1, 2}
    merged = np.flatnonzero(np.bincount(after.heirs, minlength=len(after.parents)) == 2)
    assert len(merged) == np.count_nonzero(rows == 0)
    lone = rows > 0
    assert np.array_equal(after.parents[after.heirs[lone]], np.flatnonzero(lone))
    for row in merged:
        first, second = np.flatnonzero(after.heirs == row)
        assert after.fields["volumes"][row] == before["volumes"][first] + before["volumes"][second]


def test_results_do_not_depend_on_the_number_of_threads():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    before, before_threads = cloud(3, 5000, 12, 0.5), numba.get_num_threads()
    runs = []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            frames = advected_frames(before["frames"], before["affine"], 0.3)
            after = resample(before | {"frames": frames}, cells_of(before, 8), EAGER, np.full(3, 0.125))
            nu = evolved_orientations(before["orientations"], before["affine"], 0.2, 0.7)
            runs.append(
                [
                    *after.fields.values(),
                    after.parents,
                    after.heirs,
                    nu,
                    metric_blocks(friction_metric(nu, 0.5)),
                ]
            )
    finally:
        numba.set_num_threads(before_threads)
    assert len(runs[0][0]) != 5000
    assert all(np.array_equal(one, two) for one, two in zip(*runs, strict=True))


def test_the_affine_motion_of_a_merged_particle_loses_no_energy_that_it_could_keep():
    """Merging takes the energy of what is not affine: none of it when both move with one affine field."""
    fields = cloud(3, 2, 5)
    fields["frames"] = initial_frames(np.full((2, 3), 0.2))
    fields["positions"][1] = fields["positions"][0] + [0.05, 0.0, 0.02]
    fields["affine"][1] = fields["affine"][0]
    fields["velocities"][1] = fields["velocities"][0] + fields["affine"][0] @ [0.05, 0.0, 0.02]
    fields["materials"][:] = 0
    crowded = Resampling(fewest_per_cell=1, most_per_cell=1)
    after = resample(fields, [0, 0], crowded, np.ones(3)).fields
    assert len(after["volumes"]) == 1
    np.testing.assert_allclose(after["affine"][0], fields["affine"][0], atol=1e-13)


@pytest.mark.parametrize(
    "bad",
    [
        {"merge_ratio": 2.5},
        {"merge_ratio": 0.9},
        {"split_length": -1.0},
        {"merge_reach": 0.0},
        {"most_per_cell": 0},
        {"fewest_per_cell": 65},
        {"most_per_cell": 8.5},
    ],
)
def test_bad_options_are_refused(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        Resampling(**bad)


def test_bad_fields_are_refused():
    fields = cloud(2, 5, 0)
    with pytest.raises(InputError, match=r"fields\.frames"):
        resample(
            {name: value for name, value in fields.items() if name != "frames"},
            np.zeros(5, int),
            EAGER,
            [1, 1],
        )
    with pytest.raises(InputError, match="cells"):
        resample(fields, np.zeros(4, int), EAGER, [1, 1])
    with pytest.raises(InputError, match=r"fields\.affine"):
        resample(fields | {"affine": np.zeros((5, 3, 3))}, np.zeros(5, int), EAGER, [1, 1])
    with pytest.raises(InputError, match="spacing"):
        resample(fields, np.zeros(5, int), EAGER, [1, 0])
