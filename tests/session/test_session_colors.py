from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from bags import session_of, stack_of_plates

from napari_unpack.appearance import TransferFunction, hue_distance
from napari_unpack.geometry.view import Camera, View
from napari_unpack.session import Session
from napari_unpack.session.colors import pairs_beside


def side_by_side() -> np.ndarray:
    """Three plates beside each other, seen along z, 1 next to 2 next to 3."""
    labels = np.zeros((4, 6, 12), np.uint16)
    for i in range(3):
        labels[1:3, 1:5, 4 * i : 4 * i + 4] = i + 1
    return labels


def hidden(session: Session) -> set[int]:
    return {i for i, state in session.states.items() if state.name == "HIDDEN"}


def test_the_tables_of_tints_show_what_is_packed_and_one_object_alone():
    session = session_of(stack_of_plates())
    session.unpack()
    session.hide([3])
    tints = session.packed_tints()
    assert tints.shape == (6, 4)
    assert tints.dtype == np.float32
    np.testing.assert_array_equal(tints[:, 3], [0, 0, 1, 0, 1, 1])
    assert not tints[0].any()
    alone = session.solo_tints(1)
    np.testing.assert_array_equal(alone[:, 3], [0, 1, 0, 0, 0, 0])
    session.show()
    np.testing.assert_array_equal(session.packed_tints()[:, 3], [0, 0, 1, 1, 1, 1])


def test_the_same_table_is_handed_out_until_something_changes():
    session = session_of(stack_of_plates())
    assert session.packed_tints() is session.packed_tints()
    with pytest.raises(ValueError, match="read-only"):
        session.packed_tints()[0] = 1


def test_matter_of_no_object_shows_as_a_grey_veil_where_wanted():
    session, heard = session_of(stack_of_plates()), []
    session.events.transfer_function.connect(heard.append)
    before = session.packed_tints().copy()
    assert not before[0].any()
    session.show_unlabelled = True
    red, green, blue, alpha = session.packed_tints()[0]
    assert red == green == blue
    assert 0 < alpha < 0.5
    np.testing.assert_array_equal(session.packed_tints()[1:], before[1:])
    assert not session.solo_tints(2)[0].any()
    session.show_unlabelled = False
    np.testing.assert_array_equal(session.packed_tints(), before)
    assert heard == [session.transfer_function] * 2


def test_the_paper_tints_are_a_mode():
    session = session_of(stack_of_plates())
    session.tint_mode = "hsv"
    session.apply_hues({2: 1 / 3})
    np.testing.assert_allclose(session.solo_tints(2)[2], [0, 1, 0, 1], atol=1e-6)


def test_neighbours_in_the_view_get_hues_far_apart():
    session = session_of(side_by_side())
    hues = session.recolor()
    # Two classes, {2} and {1, 3}: with a margin of 0.4 they are at least 0.2 apart.
    assert hue_distance(hues[1], hues[2]) >= 0.2 - 1e-9
    assert hue_distance(hues[2], hues[3]) >= 0.2 - 1e-9


def test_recolouring_asks_for_what_is_packed_only_and_leaves_other_hues_alone():
    session = session_of(side_by_side())
    before = session.hues
    session.hide([1])
    session.unpack([2])
    session.recolor()
    assert session.ray_queries.visible[-1] == {3}
    assert (session.hues[1], session.hues[2]) == (before[1], before[2])


def test_recolouring_again_keeps_what_separates():
    session = session_of(side_by_side())
    session.apply_hues({1: 0.11, 2: 0.52, 3: 0.93})
    assert session.recolor() == {1: 0.11, 2: 0.52, 3: 0.93}


def test_a_locked_hue_survives_recolouring():
    session = session_of(side_by_side())
    session.apply_hues({1: 0.5, 2: 0.5, 3: 0.5})
    session.locked_hues = frozenset({2})
    assert session.recolor()[2] == 0.5
    assert session.hues[1] != 0.5


def test_a_hue_that_was_locked_before_any_recolouring_survives_the_first():
    session = session_of(side_by_side())
    before = session.hues
    session.locked_hues = [1, 2]
    hues = session.recolor()
    assert {i: hues[i] for i in (1, 2)} == {i: before[i] for i in (1, 2)}
    assert hue_distance(hues[2], hues[3]) >= 0.2 - 1e-9


def test_hide_show_and_isolate():
    session = session_of(stack_of_plates())
    session.hide(2)
    assert hidden(session) == {2}
    session.isolate([4, 2])
    assert hidden(session) == {1, 3, 5}
    session.show([1])
    assert hidden(session) == {3, 5}
    session.show()
    assert hidden(session) == set()
    with pytest.raises(ValueError, match="at least one object"):
        session.isolate([])
    with pytest.raises(ValueError, match="ids must be objects of this session"):
        session.hide([77])


def test_hiding_a_sprite_brings_it_back_as_a_sprite():
    session = session_of(stack_of_plates())
    session.unpack(2)
    session.hide([1])
    assert set(session.poses) == {2}
    assert session.restore() == (2,)
    session.show([1])
    assert session.states[1].name == "UNPACKED"


def test_hiding_ends_a_flight_and_an_inspection():
    session = session_of(stack_of_plates())
    session.animated = True
    session.unpack()
    session.hide([1])
    assert session.flights == {}
    session.inspect(3)
    session.hide([3])
    session.show()
    assert session.states[3].name == "PACKED"
    assert session.states[1].name == "UNPACKED"


def test_selection_and_its_signal():
    session = session_of(stack_of_plates())
    heard: list[frozenset[int]] = []
    session.events.selected.connect(heard.append)
    session.select([2, 3])
    session.select([3, 2])
    session.select()
    assert heard == [frozenset({2, 3}), frozenset()]


def test_signals_tell_exactly_what_changed():
    session = session_of(stack_of_plates())
    heard: list[frozenset[int]] = []
    hues: list[dict[int, float]] = []
    session.events.states.connect(heard.append)
    session.events.hues.connect(hues.append)
    session.unpack(2)
    session.hide([4])
    session.hide([4])
    session.restore()
    session.apply_hues({3: 0.25})
    assert heard == [frozenset({1, 2}), frozenset({4}), frozenset({2})]
    assert [h[3] for h in hues] == [0.25]


def test_the_transfer_function_is_told_and_dragging_it_is_one_step():
    session = session_of(stack_of_plates())
    before = session.transfer_function
    heard: list[TransferFunction] = []
    session.events.transfer_function.connect(heard.append)
    for top in (0.2, 0.3, 0.4):
        session.transfer_function = TransferFunction([(0, 0), (1000, top)])
    assert [function.points[-1][1] for function in heard] == [0.2, 0.3, 0.4]
    session.undo()
    assert session.transfer_function == before
    with pytest.raises(TypeError, match="must be a TransferFunction"):
        session.transfer_function = [(0, 0), (1, 1)]


def test_a_view_is_settled_and_a_camera_is_taken_over():
    session = session_of(stack_of_plates())
    heard: list[Camera] = []
    session.events.view.connect(heard.append)
    session.view = View(direction=(0.0, 1.0, 0.0), height=55.0)
    assert session.camera.height == 55.0
    camera = View(direction=(0.2, 0.5, 0.8), fov=20.0).camera(session.labels.shape, (1, 1, 1))
    session.look(camera)
    assert session.camera is camera
    np.testing.assert_allclose(
        session.view.camera(session.labels.shape, (1, 1, 1)).rotation, camera.rotation, atol=1e-12
    )
    assert len(heard) == 2


def test_what_is_no_view_is_refused_and_changes_nothing():
    session = session_of(stack_of_plates(2))
    before = session.view, session.camera
    with pytest.raises(TypeError, match="view must be a View"):
        session.view = (0.0, 0.0, 1.0)
    assert (session.view, session.camera) == before


def test_facts_are_measured_where_nobody_gave_them():
    labels = np.zeros((4, 4, 4), np.uint16)
    labels[0, 0, 0:2] = 2
    labels[3, 1:3, 3] = 5
    volume = np.zeros((4, 4, 4), np.float32)
    volume[0, 0, 0:2] = 100, 300
    volume[3, 1:3, 3] = 50, np.nan
    table = Session(volume, labels, spacing=(2.0, 1.0, 0.5)).objects
    assert list(table.index) == [2, 5]
    assert list(table["name"]) == ["Object 2", "Object 5"]
    assert list(table["voxels"]) == [2, 2]
    assert list(table["volume_mm3"]) == [2.0, 2.0]
    assert list(table["mean_density"]) == [200.0, 50.0]
    np.testing.assert_allclose(table[["z", "y", "x"]], [[0, 0, 0.25], [6, 1.5, 1.5]])


@pytest.mark.parametrize("dtype", [np.float64, np.int32, np.uint64])
def test_densities_far_from_zero_are_measured_as_they_are(dtype):
    labels = side_by_side()
    volume = labels.astype(dtype) * dtype(20) + dtype(10**9)
    found = Session(volume, labels).objects["mean_density"]
    assert found.tolist() == [10**9 + 20 * i for i in found.index]


def test_given_facts_are_kept_and_completed():
    labels = side_by_side()
    given = pd.DataFrame(
        {"kind": ["bottle", None], "confidence": [0.9, 0.5]}, index=pd.Index([1, 2], name="id")
    )
    table = Session(labels.astype(float), labels, objects=given).objects
    assert list(table["name"]) == ["Bottle 1", "Object 2", "Object 3"]
    np.testing.assert_allclose(table["confidence"], [0.9, 0.5, np.nan])
    assert list(table["voxels"]) == [32, 32, 32]
    assert "kind" in table
    with pytest.raises(ValueError, match="each ID once"):
        Session(labels.astype(float), labels, objects=given.rename(index={2: 1}))


def test_renaming_is_undone_too():
    session = session_of(stack_of_plates())
    session.rename(2, " red doll ")
    assert session.objects.loc[2, "name"] == "red doll"
    session.undo()
    assert session.objects.loc[2, "name"] == "Object 2"
    with pytest.raises(ValueError, match="must not be blank"):
        session.rename(2, " ")


LABELS = stack_of_plates()
VOLUME = LABELS.astype(np.float32)


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ((VOLUME[0], LABELS), ValueError, r"volume must be 3D \(Z, Y, X\), got shape \(6, 8\)"),
        ((VOLUME[:0], LABELS[:0]), ValueError, "volume must not be empty"),
        ((VOLUME * np.nan, LABELS), ValueError, "NaN or infinity everywhere"),
        ((VOLUME.astype(complex), LABELS), TypeError, "volume must hold real numbers"),
        ((VOLUME, LABELS[1:]), ValueError, r"labels must have the volume's shape \(16, 6, 8\)"),
        ((VOLUME, LABELS * 0), ValueError, "labels hold no object"),
        ((VOLUME, LABELS.astype(float)), TypeError, "labels must be integers"),
        ((VOLUME, LABELS.astype(int) - 1), ValueError, "labels must not be negative"),
        ((VOLUME, LABELS, (1, 1)), ValueError, "spacing must be three positive numbers"),
        ((VOLUME, LABELS, (1, 0, 1)), ValueError, "spacing must be three positive numbers"),
    ],
)
def test_bad_input_is_refused_with_a_sentence(arguments, error, said):
    with pytest.raises(error, match=said):
        Session(*arguments)


def test_a_mask_is_a_volume_of_0_and_1_and_not_copied():
    mask = LABELS > 1
    session = Session(mask, LABELS)
    assert session.volume.dtype == np.uint8
    assert np.array_equal(session.volume, mask)
    assert np.shares_memory(session.volume, mask)


def test_labels_of_any_integer_dtype_become_uint16_and_grow_for_display():
    session = Session(VOLUME, LABELS.astype(np.int64))
    assert session.labels.dtype == np.uint16
    assert session.display_labels is session.display_labels
    assert (session.display_labels[session.labels > 0] == session.labels[session.labels > 0]).all()
    assert (session.display_labels > 0).sum() > (session.labels > 0).sum()


def test_ids_above_65535_are_renumbered_and_people_see_their_own():
    given = np.where(LABELS > 0, LABELS.astype(np.int64) * 100_000, 0)
    names = pd.DataFrame({"name": ["mine"]}, index=pd.Index([200_000], name="id"))
    session = Session(VOLUME, given, objects=names)
    assert session.labels.dtype == np.uint16
    assert session.ids == tuple(range(1, len(np.unique(LABELS[LABELS > 0])) + 1))
    assert [session.label_of(i) for i in session.ids] == [100_000 * i for i in session.ids]
    assert session.objects.loc[1, "name"] == "Object 100000"
    assert session.objects.loc[2, "name"] == "mine"
    assert session.objects["label"].tolist() == [100_000 * i for i in session.ids]
    np.testing.assert_array_equal(session.labels, LABELS)


def test_sprites_beside_each_other_get_hues_apart_and_others_keep_theirs():
    # A row of 13 blocks, all nearly one blue, as small things of one density come out.
    labels = np.zeros((4, 6, 13 * 4), np.uint16)
    for i in range(13):
        labels[1:3, 1:5, 4 * i : 4 * i + 3] = i + 1
    session = session_of(labels)
    session.recolor()
    session.unpack(12)
    blues = {i: 0.6 + 0.004 * i for i in session.ids}
    session.apply_hues(blues)
    session.locked_hues = {1}
    pairs = pairs_beside(session.state.placements, session.slots)
    alone = set(session.state.placements) - {i for pair in pairs for i in pair}
    assert len(pairs) > 8
    session.recolor()
    hues = session.hues
    assert min(hue_distance(hues[a], hues[b]) for a, b in pairs) > 0.09
    assert hues[1] == blues[1]
    assert all(hues[i] == blues[i] for i in alone)
    moved = {i for i in hues if hues[i] != blues[i]}
    # A checkerboard of two would do; the others keep the hue they had in the bag.
    assert len(moved) <= 10
    session.recolor()
    assert session.hues == hues
