"""The API: what it accepts, what it refuses and in which words, and that it passes all on."""

from __future__ import annotations

import tracemalloc
import warnings

import numpy as np
import pytest

from napari_unpack import TransferFunction, rendering
from napari_unpack.geometry.view import View
from napari_unpack.rendering.validation import checked_labels, checked_volume
from napari_unpack.thread_count import SETTING
from napari_unpack.unpacking.occlusion import ratios

CPU = {"backend": "cpu"}


class Fog:
    """A transfer function: opacity 1/4 a voxel everywhere, white."""

    domain = (0.0, 1.0)

    def table(self, n: int = 2) -> np.ndarray:
        return np.tile(np.array([1, 1, 1, 0.25], np.float32), (n, 1))


def row_of(*ids: int, dtype=np.uint16) -> np.ndarray:
    """Return a 3 x 3 x n volume with one label a layer along x, the direction of looking."""
    return np.broadcast_to(np.array(ids, dtype), (3, 3, len(ids))).copy()


def test_object_id_layers_in_order_and_of_any_shape() -> None:
    ids = rendering.object_id_layers(row_of(0, 4, 4, 2, 9), layers=3, size=(15, 31), **CPU)
    assert ids.shape == (3, 15, 31)
    assert ids[:, 7, 15].tolist() == [4, 2, 9]
    assert ids[:, 0, 0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("pitch", [0.1, 0.3, 0.55, 0.7, 0.8257, 0.9765625, 1.1])
def test_no_sheet_of_one_voxel_is_passed_over_along_an_axis(pitch) -> None:
    for n in range(2, 21):
        labels, place = row_of(*range(n + 1), 0), {"spacing": (pitch,) * 3, "size": (9, 9), **CPU}
        ids = rendering.object_id_layers(labels, layers=n, **place)
        assert ids[:, 4, 4].tolist() == list(range(1, n + 1))
        ratios = rendering.occlusion_ratios(labels, definition="exact", **place)
        assert ratios == {i: float(i > 1) for i in range(1, n + 1)}


@pytest.mark.parametrize("peeling", ["pixel", "object"])
def test_an_object_seen_beside_another_is_behind_it_by_pixel_but_not_by_object(peeling) -> None:
    # Seen along +z: 7 before the left half, 5 behind it all over, 9 behind both.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[1, :, :4], labels[3], labels[5] = 7, 5, 9
    view = View(direction=(1, 0, 0), up=(0, -1, 0), height=8.0)
    ids = rendering.object_id_layers(
        labels, view=view, layers=4, size=(8, 8), peeling=peeling, **CPU
    )
    left, right = ids[:, 4].T[[1, 6]] if ids[0, 4, 1] == 7 else ids[:, 4].T[[6, 1]]
    if peeling == "pixel":
        assert (left.tolist(), right.tolist()) == ([7, 5, 9, 0], [5, 9, 0, 0])
    else:
        assert (left.tolist(), right.tolist()) == ([7, 9, 0, 0], [5, 9, 0, 0])
    with pytest.raises(ValueError, match="peeling must be"):
        rendering.object_id_layers(labels, peeling="volume")
    for layers in ("a", None, np.nan, 1.5):
        with pytest.raises((TypeError, ValueError), match="layers must be a"):
            rendering.object_id_layers(labels, layers=layers)


def test_hidden_objects_are_as_air_everywhere() -> None:
    labels = row_of(4, 2, 9)
    ids = rendering.object_id_layers(labels, layers=2, size=(9, 9), hidden=[4], **CPU)
    assert ids[:, 4, 4].tolist() == [2, 9]
    ratios = rendering.occlusion_ratios(labels, hidden=(4,), size=(9, 9), **CPU)
    assert ratios == {2: 0.0, 9: 1.0}
    picked = rendering.pick(labels, labels, pixel=(4, 4), size=(9, 9), transfer_function=Fog(),
                          hidden={2}, **CPU)  # fmt: skip
    assert [i for i, _ in picked] == [4, 9]


@pytest.mark.parametrize("definition", ["first_hit", "exact", "eq2", "listing"])
def test_occlusion_ratios_of_a_row(definition) -> None:
    # 4 is free; 2 is behind it; 4 again behind 2: only `exact` sees that, 1 of 3 samples.
    labels = row_of(4, 4, 2, 4)
    ratios = rendering.occlusion_ratios(labels, definition=definition, size=(20, 20), **CPU)
    assert ratios == pytest.approx({2: 1.0, 4: 1 / 3 if definition == "exact" else 0.0})


def test_first_hit_bbox_divides_by_the_area_of_the_boxs_front() -> None:
    # A 4 x 4 x 1 plate at x = 6 behind a half plate: half of its front, 16 mm2, is hidden.
    # Seen along +x at 0.1 mm a pixel.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[2:6, 2:6, 6] = 2
    labels[2:4, 2:6, 3] = 1
    view = View(direction=(0, 0, 1), height=20.0)
    ratios = rendering.occlusion_ratios(
        labels, view=view, definition="first_hit_bbox", size=(200, 200), **CPU
    )
    assert ratios == pytest.approx({1: 0.0, 2: 0.5}, abs=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_the_papers_definitions_free_the_same_objects_and_exact_none_but_some_of_them(seed) -> None:
    rng = np.random.default_rng(seed)
    labels = np.zeros((20, 22, 24), np.uint16)
    for _ in range(14):
        low = rng.integers(0, 16, 3)
        part = tuple(slice(a, a + n) for a, n in zip(low, rng.integers(2, 8, 3), strict=True))
        labels[part] = rng.integers(0, 8)
    view = View(direction=tuple(rng.normal(size=3)))
    found = {
        name: rendering.occlusion_ratios(labels, view=view, definition=name, size=(90, 90), **CPU)
        for name in ("first_hit", "eq2", "listing", "first_hit_bbox", "exact")
    }
    free = {name: {i for i, r in ratios.items() if r == 0} for name, ratios in found.items()}
    assert free["first_hit"] == free["eq2"] == free["listing"] == free["first_hit_bbox"]
    assert free["exact"] <= free["first_hit"]
    assert len(found["first_hit"]) > max(2, len(free["first_hit"]))


def test_occlusion_takes_a_direction_of_looking_and_drops_perspective() -> None:
    labels = row_of(4, 2)
    assert rendering.occlusion_ratios(labels, view=(0, 0, -1), **CPU) == {2: 0.0, 4: 1.0}
    wide = rendering.occlusion(labels, view=View(fov=60.0), size=(40, 40), boxes=True, **CPU)
    plain = rendering.occlusion(labels, view=View(), size=(40, 40), boxes=True, **CPU)
    assert wide.samples.tolist() == plain.samples.tolist()
    assert wide.front_area.tolist() == plain.front_area.tolist()
    assert plain.blocks.tolist() == [[False, False], [True, False]]


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint8, np.uint64])
def test_labels_of_every_integer_type(dtype) -> None:
    ids = rendering.object_id_layers(row_of(4, 2, dtype=dtype), size=(9, 9), **CPU)
    assert ids[:, 4, 4].tolist() == [4, 2]


def test_ids_above_uint16_are_compacted_and_come_back() -> None:
    big = 7_000_000_000
    labels = row_of(70_000, big, 70_000, dtype=np.int64)
    ids = rendering.object_id_layers(labels, size=(9, 9), **CPU)
    assert ids[:, 4, 4].tolist() == [70_000, big]
    assert rendering.occlusion_ratios(labels, size=(9, 9), definition="exact", **CPU) == {
        70_000: 0.5, big: 1.0,
    }  # fmt: skip
    assert rendering.object_id_layers(labels, size=(9, 9), hidden=[70_000], **CPU)[0, 4, 4] == big
    fog = {"transfer_function": Fog(), "size": (9, 9), **CPU}
    image = rendering.render(labels, labels, tints={big: (1, 0, 0)}, shading=None, **fog)
    # 0.25 white, 0.1875 red, 0.140625 white.
    np.testing.assert_allclose(image[4, 4], [0.578125, 0.390625, 0.390625, 0.578125], atol=1e-6)
    assert [i for i, _ in rendering.pick(labels, labels, pixel=(4, 4), **fog)] == [70_000, big]
    small = row_of(70_000, 80_000, dtype=np.int64)
    counts = rendering.occlusion(small, size=(9, 9), **CPU)
    assert counts.ids.tolist() == [70_000, 80_000]
    assert counts.samples[80_000] == counts.samples.sum() / 2


def test_counts_of_sixty_thousand_objects_and_of_any_ids_take_little_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Tables with a row an ID would take 48 TiB here.
    far = 2**40
    counts = rendering.occlusion(row_of(3, far, dtype=np.int64), size=(9, 9), boxes=True, **CPU)
    near = rendering.occlusion(row_of(3, 4), size=(9, 9), boxes=True, **CPU)
    for name in ("samples", "hits", "occluded_hits", "exact_samples", "front_area"):
        ours, plain = getattr(counts, name), getattr(near, name)
        assert len(ours) == far + 1
        assert [ours[3], ours[far], ours[7]] == [plain[3], plain[4], 0]
        assert ours[counts.ids].tolist() == plain[near.ids].tolist()
    assert ratios(counts, "exact") == {3: 0.0, far: 1.0}
    many = np.repeat(np.arange(1, 60_001), 2).reshape(40, 60, 50)
    # Each thread has tables of its own, on a machine of sixteen cores too many for the limit.
    monkeypatch.setenv(SETTING, "2")
    rendering.occlusion_ratios(many, size=(9, 9), **CPU)
    tracemalloc.start()
    rendering.occlusion_ratios(many + far, size=(64, 64), **CPU)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6


def test_render_tints_hides_and_leaves_the_unlabelled_untinted() -> None:
    labels = row_of(0, 1, 2)
    args = {"transfer_function": Fog(), "size": (9, 9), "shading": None, **CPU}
    image = rendering.render(labels, labels, tints={2: (0, 1, 0, 0.5)}, hidden=[1], **args)
    # 0: 0.25 white. 1: nothing. 2: 0.125 of the remaining 0.75 in green.
    np.testing.assert_allclose(image[4, 4], [0.25, 0.34375, 0.25, 0.34375], atol=1e-6)
    bare = rendering.render(labels, labels, hidden=[0, 1, 2], **args)
    assert not bare.any()


def test_pick_gives_the_strongest_first() -> None:
    labels = row_of(5, 0, 3, 3, 3)
    picked = rendering.pick(
        labels, labels, pixel=(4, 4), size=(9, 9), transfer_function=Fog(), **CPU
    )
    # 5: 0.25; 0: 0.1875; 3: 0.5625 (1 - 0.75^3) = 0.3252.
    assert [i for i, _ in picked] == [3, 5]
    assert picked[0][1] == pytest.approx(0.5625 * (1 - 0.75**3))
    assert rendering.pick(labels, labels, pixel=(0, 0), size=(9, 9),
                        transfer_function=Fog(), **CPU) == []  # fmt: skip


def test_nan_counts_as_the_lowest_density() -> None:
    volume = row_of(5, 9, 7).astype(float)
    volume[0, 0, 0], volume[1, 1, 1], volume[2, 2, 2] = np.nan, np.inf, -np.inf
    found = checked_volume(volume)
    assert found.dtype == np.float32
    assert (found[0, 0, 0], found[1, 1, 1], found[2, 2, 2]) == (5, 9, 5)
    assert np.isnan(volume[0, 0, 0])


def test_the_look_of_a_scan_with_nan_and_infinities_is_that_of_its_finite_densities() -> None:
    rng = np.random.default_rng(0)
    labels = np.zeros((16, 16, 16), np.uint16)
    labels[4:12, 4:12, 4:12] = 1
    volume = np.where(labels, 1000.0, 0.0) + rng.normal(0, 50, labels.shape)
    chance = rng.random(labels.shape)
    volume[chance < 0.05], volume[chance > 0.96] = np.nan, np.inf
    volume[0, 0, 0] = -np.inf
    for array in (volume, volume.astype(np.float32)):
        finite = array[np.isfinite(array)].astype(np.float32)
        look = TransferFunction.default_for(finite)
        assert look != TransferFunction.default_for(checked_volume(array))
        assert look == TransferFunction.default_for(array.astype(np.float32))
        asked = {"labels": labels, "size": (12, 12), **CPU}
        plain = rendering.render(array, **asked)
        np.testing.assert_array_equal(
            plain, rendering.render(array, transfer_function=look, **asked)
        )
        picked = rendering.pick(array, pixel=(6, 6), **asked)
        assert picked == rendering.pick(array, pixel=(6, 6), transfer_function=look, **asked)


@pytest.mark.parametrize(
    ("dtype", "kept"),
    [(np.uint8, np.uint16), (np.uint16, np.uint16), (np.int16, np.float32), (float, np.float32)],
)
def test_density_types(dtype, kept) -> None:
    assert checked_volume(np.ones((2, 2, 2), dtype)).dtype == kept


def test_fitting_arrays_are_not_copied() -> None:
    array = row_of(1, 2)
    assert checked_labels(array).array is array
    assert checked_volume(array) is array


def test_densities_beyond_single_precision_count_as_the_most_there_is() -> None:
    volume = np.full((2, 2, 2), 5.0)
    volume[0, 0, 0], volume[0, 0, 1], volume[0, 1, 0] = 1e300, -1e300, np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = checked_volume(volume)
        alike = checked_volume(np.full((2, 2, 2), 1e300))
    most = found[0, 0, 0]
    assert 1e30 < most < np.inf
    assert found[0, 0, 1] == -most
    assert found[0, 1, 0] == most
    assert found[1, 1, 1] == 5
    assert (alike == most).all()


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("domain", [(5.0, 1.0), (5.0, 5.0), (np.nan, 1.0), (0.0, np.inf)])
def test_a_transfer_function_over_no_domain_is_refused(domain, backend) -> None:
    class Odd(Fog):
        pass

    Odd.domain = domain
    labels = row_of(1, 2)
    with pytest.raises(ValueError, match="domain"):
        rendering.render(labels, labels, transfer_function=Odd(), size=(3, 3), backend=backend)
    with pytest.raises(ValueError, match="domain"):
        rendering.pick(labels, labels, transfer_function=Odd(), size=(3, 3))


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_arrays_changed_in_place_are_looked_at_anew(backend) -> None:
    labels = row_of(1, 0, 2)
    volume = (labels > 0).astype(np.float32)
    shown = {"size": (8, 8), "backend": backend}
    before = rendering.render(volume, labels, transfer_function=Fog(), **shown)
    assert rendering.object_id_layers(labels, **shown)[0].max() == 1
    labels[labels == 1] = 3
    volume[labels == 3] = np.nan
    assert rendering.object_id_layers(labels, **shown)[0].max() == 3
    assert sorted(rendering.occlusion_ratios(labels, **shown)) == [2, 3]
    hidden = {"tints": {3: (1, 0, 0)}, "transfer_function": Fog()}
    after = rendering.render(volume, labels, **hidden, **shown)
    assert after[4, 4, 1] < 0.9 * before[4, 4, 1]


def test_densities_stay_so_far_below_the_largest_float_that_their_gradients_are_finite() -> None:
    most = np.finfo(np.float32).max
    volume = np.array([[[most, -most, 5, np.nan, np.inf, -np.inf]]], np.float32)
    found = checked_volume(volume)
    np.testing.assert_array_equal(
        found, np.array([[[1e37, -1e37, 5, -1e37, 1e37, -1e37]]], np.float32)
    )
    assert volume[0, 0, 0] == most
    with np.errstate(over="raise"):
        twice = np.subtract.outer(found, found)
        np.subtract.outer(twice, twice)


ONES = np.ones((3, 3, 3), np.uint16)


TOO_LARGE = (
    "^a picture of 300000 x 200000 pixels needs 7,200.0 GB of memory, and .* GB of memory are "
    "free: ask for fewer pixels$"
)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"labels": np.ones((3, 3), int)}, ValueError, "labels must be 3D"),
        ({"labels": np.ones((0, 3, 3), int)}, ValueError, "labels must not be empty"),
        ({"labels": -np.ones((3, 3, 3), int)}, ValueError, "labels must not be negative"),
        ({"labels": np.ones((3, 3, 3))}, TypeError, "labels must be integers"),
        ({"volume": np.ones((3, 3))}, ValueError, "volume must be 3D"),
        ({"volume": np.ones((3, 3, 4))}, ValueError, "one shape"),
        ({"volume": np.full((3, 3, 3), np.nan)}, ValueError, "finite"),
        ({"volume": np.ones((3, 3, 3), complex)}, TypeError, "volume must hold real"),
        ({"spacing": (1, 1)}, ValueError, "spacing"),
        ({"spacing": (1, 0, 1)}, ValueError, "spacing"),
        ({"spacing": (1, np.nan, 1)}, ValueError, "spacing"),
        ({"size": (0, 4)}, ValueError, "size"),
        ({"size": (4, 4, 4)}, ValueError, "size"),
        ({"size": (200_000, 300_000)}, ValueError, TOO_LARGE),
        ({"backend": "cuda"}, ValueError, "backend"),
        ({"hidden": "12"}, TypeError, "hidden"),
        ({"hidden": [1.5]}, TypeError, "hidden"),
        ({"hidden": [True, 2]}, TypeError, "hidden must hold object IDs"),
        ({"tints": {1.7: (1, 0, 0)}}, TypeError, "tints must hold object IDs"),
        ({"tints": {"2": (1, 0, 0)}}, TypeError, "tints must hold object IDs"),
        ({"tints": {1: (1, 2, 0)}}, ValueError, "tints"),
        ({"tints": {1: (1, 0)}}, ValueError, "tints"),
        ({"tints": {1: "red"}}, ValueError, "tints must be .* got 'red'"),
        ({"step": 0.0}, ValueError, "step"),
        ({"step": 1e-12}, ValueError, "step must be a number of mm, .* of the shortest voxel"),
        ({"step": 1e300}, ValueError, "step must be a number of mm, .* to 1e"),
        ({"size": (np.nan, 4)}, ValueError, "two positive integers"),
        ({"size": 5}, ValueError, "two positive integers"),
    ],
)
def test_bad_input_is_refused_by_name(arguments, error, message) -> None:
    given = {"volume": ONES, "labels": ONES, "transfer_function": Fog(), "size": (4, 4), **CPU}
    with pytest.raises(error, match=message):
        rendering.render(**{**given, **arguments})


@pytest.mark.parametrize("pixel", [(1,), (-0.5, 2), (4, 0), (0, np.nan)])
def test_a_pixel_outside_the_picture_is_refused(pixel: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"pixel must lie inside a picture of \(4, 4\)"):
        rendering.pick(ONES, ONES, pixel=pixel, size=(4, 4), transfer_function=Fog(), **CPU)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize(
    ("planes", "message"),
    [
        ([[0, 0, 1]], "clipping must be"),
        ([[[1, 1, 1], [0, 0, 1]]] * 9, "clipping must be"),
        ([[[np.nan, 1, 1], [0, 0, 1]]], "clipping must hold finite"),
        ([[[1, 1, 1], [0, 0, 0]]], "clipping must hold finite"),
    ],
)
def test_planes_that_cut_nothing_are_refused_by_both_backends(planes, message, backend) -> None:
    given = {"transfer_function": Fog(), "size": (4, 4), "backend": backend, "clipping": planes}
    with pytest.raises(ValueError, match=message):
        rendering.render(ONES, ONES, **given)
    with pytest.raises(ValueError, match=message):
        rendering.pick(ONES, ONES, **given)


def test_no_planes_cut_nothing() -> None:
    given = {"transfer_function": Fog(), "size": (4, 4), **CPU}
    whole = rendering.render(ONES, ONES, **given)
    np.testing.assert_array_equal(rendering.render(ONES, ONES, clipping=[], **given), whole)


def test_too_many_objects_layers_pixels_and_definitions() -> None:
    with pytest.raises(ValueError, match="65,535 objects"):
        checked_labels(np.arange(1, 70_001).reshape(10, 70, 100) * 2)
    with pytest.raises(ValueError, match="layers"):
        rendering.object_id_layers(ONES, layers=0, **CPU)
    with pytest.raises(ValueError, match="512 x 512 pixels needs 3,145"):
        rendering.object_id_layers(ONES, layers=10**6, **CPU)
    with pytest.raises(ValueError, match=TOO_LARGE):
        rendering.occlusion_ratios(ONES, size=(200_000, 300_000), **CPU)
    with pytest.raises(ValueError, match="pixel"):
        rendering.pick(ONES, ONES, pixel=(4, 0), size=(4, 4), transfer_function=Fog(), **CPU)
    with pytest.raises(ValueError, match="definition"):
        rendering.occlusion_ratios(ONES, definition="guess", **CPU)


@pytest.mark.parametrize("view", [(1, 2), 5, (0, 0, 0), (0, np.nan, 1)])
def test_a_direction_of_looking_that_is_none_is_refused_by_name(view) -> None:
    with pytest.raises(ValueError, match="view must"):
        rendering.occlusion_ratios(ONES, view=view, **CPU)


def test_pictures_take_views_only() -> None:
    for function in (rendering.object_id_layers, rendering.render, rendering.pick):
        volume = () if function is rendering.object_id_layers else (np.arange(27).reshape(3, 3, 3),)
        with pytest.raises(TypeError, match="view must be a View"):
            function(*volume, ONES, view=(0, 0, 1), **CPU)


def test_the_largest_ids_keep_every_digit_and_larger_ones_are_refused() -> None:
    # 2^55 + 1 is no float64, and without a background 0 joins the list of IDs.
    big = 2**55 + 1
    ids = rendering.object_id_layers(np.full((3, 3, 3), big, np.uint64), size=(5, 5), **CPU)
    assert int(ids[0, 2, 2]) == big
    with pytest.raises(ValueError, match="labels must be below"):
        checked_labels(np.full((3, 3, 3), 2**63, np.uint64))


def test_render_lays_a_background_and_the_objects_box_around_the_bag() -> None:
    labels = np.zeros((20, 20, 20), np.uint16)
    labels[8:12, 5:15, 5:15] = 1
    volume = np.where(labels > 0, 1500, 0).astype(np.uint16)
    view = View((1.0, 0.0, 0.0), height=40.0)
    bare = rendering.render(volume, labels, view=view, size=(80, 80), backend="cpu")
    assert bare[0, 0, 3] == 0
    image = rendering.render(
        volume, labels, view=view, size=(80, 80), backend="cpu",
        background="#ff0000,#0000ff", decorations=["box", "scale"],
    )  # fmt: skip
    np.testing.assert_allclose(image[0, 0], [1, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(image[-1, 0], [0, 0, 1, 1], atol=1e-6)
    # Two pixels a mm: the box from 4.5 to 14.5 about 9.5 spans rows and columns 29.5 to 49.5.
    inside = (slice(33, 46), slice(33, 46))
    np.testing.assert_allclose(
        image[inside][bare[inside][..., 3] > 0.995][:, 0],
        bare[inside][bare[inside][..., 3] > 0.995][:, 0],
        atol=0.01,
    )
    assert image[29:31, 40, 1].max() > 0.25
    with pytest.raises(ValueError, match="decorations must be out of"):
        rendering.render(volume, labels, decorations=["bow"])
