"""Objects of a large grid, found in blocks: whole across borders, on one scale of densities."""

from __future__ import annotations

from typing import Any

import cc3d
import numpy as np
import pytest
from numpy.typing import NDArray

import napari_unpack as nu
from napari_unpack import memory
from napari_unpack.segmentation import large_volumes, pipeline
from napari_unpack.segmentation.overlapping_blocks import (
    find_in_blocks,
    matches,
    overlapping_blocks,
)
from napari_unpack.tasks import SILENT, Cancelled, Share

MM = (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("shape", "most", "overlap"),
    [
        ((40, 50, 60), 10**6, 8),
        ((40, 50, 60), 20_000, 8),
        ((7, 200, 31), 5_000, 10),
        ((1, 1, 5000), 700, 64),
        ((90, 90, 90), 1, 20),
    ],
)
def test_own_parts_fill_the_grid_and_neighbours_share_as_much_as_asked(shape, most, overlap):
    own, seen = np.zeros(shape, int), np.zeros(shape, int)
    places = overlapping_blocks(shape, most, overlap)
    sides = {p.place: p.box for p in places}
    for place in places:
        own[place.own] += 1
        seen[place.box] += 1
        sizes = [s.stop - s.start for s in place.box]
        # A block is never so thin that it would be all overlap.
        assert np.prod(sizes) <= most or max(sizes) <= 2 * overlap
        for axis in range(3):
            after = list(place.place)
            after[axis] += 1
            if tuple(after) in sides:
                shared = place.box[axis].stop - sides[tuple(after)][axis].start
                assert overlap <= shared
    assert (own == 1).all()
    assert (seen >= 1).all()
    assert len(places) == 1 or most < np.prod(shape)


def _shapes() -> NDArray[np.int32]:
    """Return balls, a rod through all blocks, and two plates that touch all along."""
    z, y, x = np.indices((60, 64, 150))
    truth = np.zeros(z.shape, np.int32)
    rng = np.random.default_rng(3)
    for name in range(1, 20):
        middle = rng.uniform(8, (52, 44, 142))
        ball = sum((g - m) ** 2 for g, m in zip((z, y, x), middle, strict=True)) < 7**2
        truth[ball & (truth == 0)] = name
    truth[28:33, 55:60, 3:147] = 20
    truth[40:44, 50:64, 20:130] = 21
    truth[44:48, 50:64, 20:130] = 22
    return truth


def _named(values: NDArray[Any], _spacing: Any, _share: Share) -> NDArray[np.int32]:
    """Find what has one value and hangs together, as names 1, 2, ... of the block's own."""
    return cc3d.connected_components(values, connectivity=6).astype(np.int32)


def test_objects_across_blocks_are_one_and_neighbours_stay_apart():
    truth = cc3d.connected_components(_shapes(), connectivity=6)
    counts = np.bincount(truth.reshape(-1))
    truth[counts[truth] < 100] = 0
    found = find_in_blocks(truth, MM, _named, SILENT, most=90_000, overlap=24)
    assert len(overlapping_blocks(truth.shape, 90_000, 24)) >= 10
    pairs = np.unique(np.stack([truth.reshape(-1), found.reshape(-1)]), axis=1)
    # Each has one name, of its own; names have no gaps.
    assert len(pairs[0]) == len(np.unique(pairs[0])) == len(np.unique(pairs[1]))
    assert sorted(pairs[1]) == list(range(len(pairs[1])))


def test_labels_match_where_most_of_both_is_the_same():
    one = np.array([[1, 1, 1, 1, 2, 2, 0, 3, 3, 3, 4]], np.int32)
    two = np.array([[9, 9, 9, 0, 5, 6, 6, 7, 7, 7, 7]], np.int32)
    # 1 and 9: three of four. 2 and 5: one of two, 2 and 6: one of three, 4 and 7: one of four.
    assert matches(one, two).tolist() == [[1, 9], [3, 7]]
    assert matches(one, np.zeros_like(one)).shape == (0, 2)


@pytest.mark.parametrize(("first", "kept"), [(97, 0), (90, 250)])
def test_a_crumb_is_dropped_where_the_block_beside_saw_no_object(first: int, kept: int):
    volume = np.zeros((20, 20, 200), np.int32)
    volume[5:10, 5:10, first:118] = 1
    places = overlapping_blocks(volume.shape, 50_000, 30)
    assert [p.own[2].stop for p in places] == [100, 200]
    blocks = iter(places)

    def seen_first_alone(values: NDArray[Any], _spacing: Any, _share: Share) -> NDArray[np.int32]:
        return values if next(blocks) is places[0] else np.zeros_like(values)

    found = find_in_blocks(volume, MM, seen_first_alone, SILENT, most=50_000, overlap=30)
    assert found.sum() == kept
    assert found[..., 100:].sum() == 0


@pytest.fixture
def balls() -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
    """Return balls of two densities in noisy air, all in one half of the volume."""
    shape = (56, 56, 168)
    at = np.indices(shape)
    truth = np.zeros(shape, np.int32)
    for n, center in enumerate(np.ndindex(2, 2, 3), start=1):
        middle = np.array([14, 14, 14]) + 28 * np.array(center)
        truth[((at - middle[:, None, None, None]) ** 2).sum(axis=0) < 10**2] = n
    densities = np.where(truth % 2, 1500, 1100) * (truth > 0)
    noise = np.random.default_rng(0).normal(60, 20, shape)
    return np.clip(noise + densities, 0, None).astype(np.uint16), truth


def _in_small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "WORKING_VOXELS", 200_000)
    monkeypatch.setitem(find_in_blocks.__kwdefaults__, "most", 130_000)
    monkeypatch.setitem(find_in_blocks.__kwdefaults__, "overlap", 24)


@pytest.mark.parametrize("method", ["learned", "cuts"])
def test_a_volume_with_many_things_is_segmented_in_blocks(monkeypatch, balls, method):
    volume, truth = balls
    _in_small_blocks(monkeypatch)
    places = overlapping_blocks(volume.shape, 130_000, 24)
    # Balls are cut by blocks, and a block has nothing but noise.
    assert len(places) > 4
    whole = np.bincount(truth.reshape(-1))
    assert not any(
        (np.bincount(truth[p.own].reshape(-1), minlength=13) == whole).all() for p in places
    )
    assert any(not truth[p.box].any() for p in places)
    told: list[float] = []
    found = nu.segment(
        volume, MM, progress=lambda f, _: told.append(f), working=10**7, method=method
    )
    assert told == sorted(told)
    assert len(found.objects) == 12
    for name in range(1, 13):
        inside = truth == name
        own = np.bincount(found.labels[inside]).argmax()
        both = (found.labels == own) & inside
        assert both.sum() > 0.85 * (inside | (found.labels == own)).sum()


def test_a_table_is_told_from_a_board_by_the_whole_volume(monkeypatch):
    _in_small_blocks(monkeypatch)
    most = 48 * 72 * 76
    monkeypatch.setitem(find_in_blocks.__kwdefaults__, "most", most)
    truth = np.zeros((48, 72, 176), np.int32)
    # It goes on at both ends of the block in the middle, as a table does, but not of the volume.
    truth[5:9, 10:54, 42:134] = 1
    truth[14:36, 6:34, 88:162] = 2
    truth[14:36, 38:66, 14:94] = 3
    table = np.zeros(truth.shape, np.bool_)
    table[40:43, 14:60] = True
    _, middle, _ = overlapping_blocks(truth.shape, most, 24)
    assert 42 < middle.box[2].start < middle.box[2].stop < 134
    densities = np.where(truth > 0, 1300, 0) + np.where(table, 900, 0)
    noise = np.random.default_rng(0).normal(60, 20, truth.shape)
    volume = np.clip(noise + densities, 0, None).astype(np.uint16)
    given: list[Any] = []

    def looked_at(density: NDArray[Any], _spacing: Any, find: Any, *_: Any) -> NDArray[np.int32]:
        given.append((density, find.keywords["options"].foreground))
        return find_in_blocks(density, _spacing, find, *_)

    monkeypatch.setattr(pipeline, "find_in_blocks", looked_at)
    found = nu.segment(volume, (3.0, 3.0, 3.0), working=10**7).labels
    ((density, options),) = given
    assert not options.supports
    assert (density[table] < 200).all()
    np.testing.assert_array_equal(density[truth > 0], volume[truth > 0])
    assert not found[table].any()
    for name in (1, 2, 3):
        inside = truth == name
        own = np.bincount(found[inside]).argmax()
        assert own > 0
        assert ((found == own) & inside).sum() > 0.8 * (inside | (found == own)).sum()


def test_blocks_of_noise_alone_are_nothing_and_say_so(monkeypatch):
    _in_small_blocks(monkeypatch)
    noise = np.random.default_rng(1).normal(60, 20, (56, 56, 90)).astype(np.float32)
    with pytest.raises(ValueError, match="nothing found"):
        nu.segment(noise, MM, working=10**7, foreground=400.0)


def test_a_grid_for_which_there_is_no_memory_is_refused_before_it_is_made(monkeypatch, balls):
    _in_small_blocks(monkeypatch)
    monkeypatch.setattr(large_volumes, "WORKING_VOXELS", 200_000)
    monkeypatch.setattr(memory, "free_memory", lambda: 10**6)
    with pytest.raises(ValueError, match=r"finding objects in 526,848 cells needs .* smaller wor"):
        nu.segment(balls[0], MM, working=10**7)


def test_a_block_is_cancelled_within():
    def find(values: NDArray[Any], _spacing: Any, share: Share) -> NDArray[np.int32]:
        share(0.5)
        raise AssertionError("not cancelled")

    def cancel(fraction: float, _text: str) -> None:
        if fraction > 0:
            raise Cancelled

    with pytest.raises(Cancelled):
        find_in_blocks(np.zeros((9, 9, 9)), MM, find, Share(cancel), most=10**6)
