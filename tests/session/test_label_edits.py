"""Split, merge, delete and paint: undone to the voxel, and everything derived follows."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.grow_labels import grow_labels
from napari_unpack.geometry.view import View
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.segmentation.object_table import object_table as measured
from napari_unpack.session import ObjectState, Session
from napari_unpack.session.errors import listed_objects
from napari_unpack.session.measurements import SurfacePoint, owner_after
from napari_unpack.tasks import no_progress


def dumbbell() -> tuple[np.ndarray, np.ndarray]:
    """Two cubes of 10 joined by a bar of 2 x 2 (object 1), a cube (2) and a plate (3)."""
    labels = np.zeros((20, 24, 40), np.uint16)
    labels[4:14, 4:14, 3:13] = 1
    labels[4:14, 4:14, 19:29] = 1
    labels[8:10, 8:10, 13:19] = 1
    labels[4:10, 16:22, 4:10] = 2
    labels[4:10, 16:18, 10:30] = 3
    volume = np.where(labels > 0, 900 + 100 * labels, 0).astype(np.uint16)
    return volume, labels


LEFT, RIGHT = (8, 8, 5), (8, 8, 26)


def session() -> Session:
    volume, labels = dumbbell()
    facts = pd.DataFrame(
        {"kind": ["dumbbell", "cube", "plate"], "confidence": [0.2, 0.9, 0.9]},
        index=pd.Index([1, 2, 3], name="id"),
    )
    made = Session(volume, labels, (1.0, 1.0, 2.0), facts)
    made.view = View((1, 0, 0))
    made.direction = (-1, 0, 0)
    return made


def assert_consistent(s: Session) -> None:
    boxes = label_boxes(s.labels)
    for name in ("ids", "lower", "upper", "counts"):
        assert np.array_equal(getattr(s.boxes, name), getattr(boxes, name)), name
    assert s.ids == tuple(boxes.ids)
    assert set(s.states) == set(s.hues) == set(s.ids)
    assert np.array_equal(s.display_labels, grow_labels(s.labels))
    table = s.objects
    fresh = Session(s.volume, s.labels, s.spacing).objects
    assert table.index.tolist() == fresh.index.tolist()
    for column in ("voxels", "volume_mm3", "mean_density", "z", "y", "x"):
        assert table[column].to_numpy(float) == pytest.approx(fresh[column].to_numpy(float))
    assert s.packed_tints().shape[0] > s.labels.max()
    assert s.selected <= set(s.ids)


def test_a_split_gives_each_side_its_own_object_and_its_own_confidence() -> None:
    s = session()
    s.label_editor.oracle = lambda region: region.voxels / 2000
    told = []
    s.events.labels.connect(told.append)
    s.display_labels  # noqa: B018
    new = s.split(1, LEFT, RIGHT)
    assert new == 4
    sides = {int(s.labels[LEFT]), int(s.labels[RIGHT])}
    assert sides == {1, 4}
    assert (s.labels[4:14, 4:14, 3:13] == s.labels[LEFT]).all()
    assert (s.labels[4:14, 4:14, 19:29] == s.labels[RIGHT]).all()
    assert told == [frozenset({1, 4})]
    assert_consistent(s)
    # The dumbbell was 0.2 in the table given; both parts are judged anew.
    voxels = s.objects.voxels[[1, 4]]
    assert voxels.sum() == 2024
    assert s.objects.confidence[[1, 4]].tolist() == (voxels / 2000).tolist()
    assert s.objects.confidence[2] == 0.9
    assert s.objects["name"][4] == "Dumbbell 1, part"
    assert s.objects["kind"].tolist() == ["dumbbell", "cube", "plate", "dumbbell"]
    assert s.states[4] is ObjectState.PACKED


def test_undo_and_redo_bring_labels_and_facts_back_to_the_voxel() -> None:
    s = session()
    first, facts = s.labels.copy(), s.objects
    s.split(1, LEFT, RIGHT)
    second, later = s.labels.copy(), s.objects
    s.recolor(undoable=False)
    s.rename(4, "Right weight")
    s.undo()
    s.undo()
    assert np.array_equal(s.labels, first)
    pd.testing.assert_frame_equal(s.objects, facts, check_dtype=False)
    assert_consistent(s)
    s.redo()
    assert np.array_equal(s.labels, second)
    pd.testing.assert_frame_equal(s.objects, later, check_dtype=False)
    assert_consistent(s)


def test_merge_keeps_the_largest_and_delete_leaves_background() -> None:
    s = session()
    assert s.merge([3, 2]) == 3
    assert (s.labels[4:10, 16:22, 4:10] == 3).all()
    assert s.ids == (1, 3)
    assert_consistent(s)
    s.delete(1)
    assert s.ids == (3,)
    assert not s.labels[LEFT]
    assert_consistent(s)
    with pytest.raises(ValueError, match="at least one"):
        s.delete([3])
    with pytest.raises(ValueError, match="at least two"):
        s.merge([3, 3])
    s.undo()
    s.undo()
    assert np.array_equal(s.labels, dumbbell()[1])
    assert_consistent(s)


def test_one_voxel_twice_is_no_split_and_named_as_it_was_given() -> None:
    s = session()
    with pytest.raises(ValueError, match=r"two different voxels, got \[5, 17, 5\] twice"):
        s.label_editor.split_task(2, [5, 17, 5], (5, 17, 5))


def test_what_is_outside_is_refused_with_a_sentence() -> None:
    s = session()
    s.unpack([2])
    before = s.labels
    for repair in (
        lambda: s.delete(2),
        lambda: s.merge([2, 3]),
        lambda: s.split(2, (5, 17, 5), (5, 20, 8)),
    ):
        with pytest.raises(ValueError, match="Cube 2 must be in the bag to be repaired: restore"):
            repair()
    # What is hidden is not restored before it shows.
    s.hide(2)
    with pytest.raises(ValueError, match="to be repaired: show and restore first"):
        s.delete(2)
    s.show()
    assert s.labels is before
    s.merge([1, 3])
    assert_consistent(s)
    assert s.states[2] is ObjectState.UNPACKED
    s.restore()
    s.delete(2)
    assert s.ids == (1,)


def test_the_queue_asks_anew_after_a_repair() -> None:
    s = session()
    stale = s.queries.occlusion_task()
    s.unpackable()
    s.merge([2, 3])
    assert s.queue.ids == ()
    assert not s.queries.store(stale, stale.run(no_progress))
    assert set(s.unpackable()) == {1, s.labels[5, 17, 5]}


def test_a_brush_is_taken_over_and_can_be_undone() -> None:
    s = session()
    s.hide([2])
    painted = s.labels.astype(np.int32)
    painted[4:6, 4:6, 3:13] = 7
    painted[15, 2:4, 30:34] = 3
    edited = s.label_editor.paint_task(painted).run(no_progress)
    assert edited is not None
    assert s.label_editor.apply(edited)
    assert np.array_equal(s.labels, painted)
    assert s.ids == (1, 2, 3, 7)
    assert s.states[2] is ObjectState.HIDDEN
    assert_consistent(s)
    assert not s.label_editor.apply(edited)
    assert s.label_editor.paint_task(s.labels).run(no_progress) is None
    s.undo()
    assert np.array_equal(s.labels, dumbbell()[1])
    assert s.states[2] is ObjectState.HIDDEN
    assert_consistent(s)


def test_a_new_object_leaves_columns_of_numbers_what_they_are() -> None:
    volume, labels = dumbbell()
    facts = pd.DataFrame(
        {"score": [0.25, 0.5, 0.75], "parent": [0, 1, 1], "shelf": ["a", "b", "c"]},
        index=pd.Index([1, 2, 3], name="id"),
    ).assign(whole=[True, False, True], key=[2**60 + 1, 4, 5], day=pd.Timestamp("2026-11-28 10:00"))
    s = Session(volume, labels, objects=facts)
    before = s.objects
    painted = labels.copy()
    painted[16:19, 2:5, 2:5] = 7
    s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    np.testing.assert_array_equal(s.objects["score"].to_numpy(), [0.25, 0.5, 0.75, np.nan])
    np.testing.assert_array_equal(s.objects["parent"].to_numpy(), [0.0, 1.0, 1.0, np.nan])
    assert s.objects["score"].dtype == s.objects["parent"].dtype == np.float64
    assert s.objects["shelf"].isna().tolist() == [False, False, False, True]
    assert s.objects["key"].tolist()[0] == 2**60 + 1
    s.undo()
    pd.testing.assert_frame_equal(s.objects, before)
    s.redo()
    assert s.objects["whole"].tolist()[:3] == [True, False, True]
    assert s.objects["key"].tolist()[0] == 2**60 + 1


def test_surface_over_volume_is_that_of_what_a_repair_made() -> None:
    volume, labels = dumbbell()
    known = measured(labels.astype(np.int32), volume, (1.0, 1.0, 2.0))
    s = Session(volume, labels, (1.0, 1.0, 2.0), known)
    s.split(1, LEFT, RIGHT)
    s.merge([2, 3])
    fresh = measured(np.asarray(s.labels, np.int32), volume, (1.0, 1.0, 2.0))
    np.testing.assert_allclose(s.objects["isoperimetric_ratio"], fresh["isoperimetric_ratio"])


def test_a_stroke_on_what_is_outside_is_refused_and_the_rest_counts() -> None:
    s = session()
    s.unpack([2])
    painted = s.labels.copy()
    painted[4:6, 16:22, 4:10] = 3
    painted[15, :2, :2] = 2
    refused = s.label_editor.paint_task(painted).run(no_progress)
    assert len(refused.refused.where) == 76
    # Nothing is left of it, which is no step of undo.
    steps = len(s.history.done)
    assert s.label_editor.apply(refused)
    assert len(s.history.done) == steps
    painted[15, 2:4, 30:34] = 7
    assert s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    wanted = dumbbell()[1]
    wanted[15, 2:4, 30:34] = 7
    assert np.array_equal(s.labels, wanted)
    assert s.states[2] is ObjectState.UNPACKED
    assert_consistent(s)


@pytest.mark.parametrize("factor", [1, 100_000])
def test_a_label_below_zero_is_refused_by_its_number(factor: int) -> None:
    volume, labels = dumbbell()
    s = Session(volume, labels.astype(np.int64) * factor)
    painted = labels.astype(np.int64) * factor
    painted[0, 0, :5] = -5
    with pytest.raises(ValueError, match="got -5"):
        s.label_editor.paint_task(painted).run(no_progress)


@pytest.mark.parametrize("dtype", [np.uint64, ">u8", np.int64])
def test_a_brush_tells_ids_apart_that_no_float_does(dtype: str) -> None:
    volume, labels = dumbbell()
    huge = 720575940612453042
    painted = np.array([0, huge, huge + 1, huge + 2], dtype)[labels]
    s = Session(volume, painted)
    painted[15, 2:4, 30:34] = huge + 1
    painted[0, 0, :5] = huge + 3
    assert s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    known = [0, *map(s.label_of, s.ids)]
    assert known == [0, huge, huge + 1, huge + 2, huge + 3]
    assert np.array_equal(np.array(known, dtype)[s.labels], painted)
    assert_consistent(s)


def test_a_label_above_all_that_tables_hold_is_refused_by_its_number() -> None:
    volume, labels = dumbbell()
    painted = labels.astype(np.uint64) * np.uint64(100_000)
    s = Session(volume, painted)
    painted[0, 0, :5] = 2**63
    with pytest.raises(ValueError, match=f"got {2**63}"):
        s.label_editor.paint_task(painted).run(no_progress)


def test_ids_above_65535_leave_a_column_label_of_ones_own_as_it_is() -> None:
    volume, labels = dumbbell()
    facts = pd.DataFrame({"label": ["cup", "book", "pen"]}, index=[100_000, 200_000, 300_000])
    s = Session(volume, labels.astype(np.int64) * 100_000, objects=facts)
    assert s.objects.label.tolist() == ["cup", "book", "pen"]
    s.delete(2)
    assert s.objects.label.tolist() == ["cup", "pen"]
    painted = s.labels.astype(np.int64) * 100_000
    painted[16:19, 2:5, 2:5] = 400_000
    s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    assert s.objects.label.fillna("?").tolist() == ["cup", "pen", "?"]


def test_ids_above_65535_keep_the_names_people_know() -> None:
    volume, labels = dumbbell()
    s = Session(volume, labels.astype(np.int64) * 100_000)
    new = s.split(1, LEFT, RIGHT)
    assert s.label_of(new) == 300_001
    assert listed_objects(s.objects["name"]) == (
        "Object 100000, Object 200000, Object 300000 and Object 100000, part"
    )
    assert listed_objects(s.objects["name"][:3]) == "Objects 100000, 200000 and 300000"
    assert s.objects.label.tolist() == [100_000, 200_000, 300_000, 300_001]
    painted = np.array([s.label_of(i) if i else 0 for i in range(5)])[s.labels]
    assert s.label_editor.paint_task(painted).run(no_progress) is None
    painted[0, 0, :5] = 700_000
    assert s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    assert s.label_of(int(s.labels[0, 0, 0])) == 700_000
    assert_consistent(s)


def test_painting_a_new_id_where_there_is_no_room_is_refused(monkeypatch) -> None:
    volume, labels = dumbbell()
    s = Session(volume, labels.astype(np.int64) * 100_000)
    monkeypatch.setattr("napari_unpack.session.label_edits.MOST_ID", max(s.ids))
    s.delete(2)
    painted = np.array([0, 100_000, 0, 300_000])[s.labels]
    painted[0, 0, :5] = 999_999
    with pytest.raises(ValueError, match="no room for a new object 999999"):
        s.label_editor.paint_task(painted).run(no_progress)
    painted[0, 0, :5] = 200_000
    s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
    assert set(s.labels[0, 0, :5]) == {2}


def test_new_objects_beside_the_largest_id_there_can_be_take_ids_that_were_never_given() -> None:
    volume, labels = dumbbell()
    s = Session(volume, np.array([0, 2, 2**63 - 1, 3])[labels])
    s.delete(next(i for i in s.ids if s.label_of(i) == 3))
    first = s.split(1, LEFT, RIGHT)
    second = s.split(1, LEFT, tuple(np.argwhere(s.labels == 1)[-1]))
    assert [s.label_of(i) for i in (first, second)] == [1, 4]
    assert s.label_data.given_ids.tolist() == [0, 2, 3, 2**63 - 1, 1, 4]


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [((0, 0, 0), RIGHT, "a must be a voxel"), (LEFT, (5, 17, 5), "b must be a voxel"),
     (LEFT, (99, 0, 0), "b must be a voxel"), (LEFT, LEFT, "different"),
     (np.add(LEFT, 0.4), RIGHT, "a must be a voxel .* whole numbers"), (5, RIGHT, "a must be"),
     (LEFT, [str(i) for i in RIGHT], "b must be a voxel"), (LEFT, (np.nan, 1, 1), "b must be")],
)  # fmt: skip
def test_points_that_cannot_split_are_named(a, b, words) -> None:
    s = session()
    with pytest.raises(ValueError, match=words):
        s.split(1, a, b)
    assert [step.verb for step in s.history.done] == ["direction"]


@given(st.lists(st.tuples(st.sampled_from("smdpu"), st.integers(0, 10**6)), max_size=6))
@settings(max_examples=15, deadline=None)
def test_any_row_of_repairs_can_be_taken_back(row: list[tuple[str, int]]) -> None:
    s = session()
    first = s.labels.copy()
    s.display_labels  # noqa: B018
    for verb, number in row:
        rng = np.random.default_rng(number)
        ids = rng.permutation(s.ids)
        if verb == "s":
            spots = np.argwhere(s.labels == ids[0])
            if len(spots) > 1:
                a, b = spots[rng.choice(len(spots), 2, replace=False)]
                s.split(int(ids[0]), a, b)
        elif verb == "m" and len(ids) > 1:
            s.merge(int(i) for i in ids[:2])
        elif verb == "d" and len(ids) > 1:
            s.delete(int(ids[0]))
        elif verb == "p":
            painted = s.labels.copy()
            z, y, x = (int(rng.integers(0, n - 4)) for n in s.labels.shape)
            painted[z : z + 4, y : y + 4, x : x + 4] = rng.integers(0, 9)
            if painted.any():
                s.label_editor.apply(s.label_editor.paint_task(painted).run(no_progress))
        elif verb == "u" and s.history.done:
            s.undo()
        assert_consistent(s)
    last, count = s.labels.copy(), len(s.history.done)
    while s.history.done:
        s.undo()
    assert np.array_equal(s.labels, first)
    assert_consistent(s)
    for _ in range(count):
        s.redo()
    assert np.array_equal(s.labels, last)
    assert_consistent(s)


def test_the_last_repair_is_taken_back_and_made_again_without_a_copy_of_the_volume() -> None:
    s = session()
    s.display_labels  # noqa: B018
    given, shown = s.labels, s.display_labels
    s.merge([2, 3])
    merged = s.labels
    assert s.queries.labels_task("undo") is None
    s.undo()
    assert s.labels is given
    assert s.display_labels is shown
    assert_consistent(s)
    assert s.queries.labels_task("redo") is None
    s.redo()
    assert s.labels is merged
    assert_consistent(s)


def test_labels_of_earlier_repairs_can_be_worked_out_beforehand() -> None:
    s = session()
    given = s.labels.copy()
    s.merge([2, 3])
    s.delete([1])
    s.rename(3, "a part")
    # Neither a name nor the last repair need labels to be worked out.
    for _ in range(2):
        assert s.queries.labels_task("undo") is None
        s.undo()
    task = s.queries.labels_task("undo")
    assert task is not None
    data = task.run(no_progress)
    assert s.queries.store(task, data)
    assert s.queries.labels_task("undo") is None
    s.undo()
    assert s.labels is data.labels
    assert np.array_equal(s.labels, given)
    assert_consistent(s)
    # A result that is stored too late does no harm.
    assert not s.queries.store(task, data)
    s.redo()
    assert set(s.ids) < {1, 2, 3}
    assert_consistent(s)


def test_a_new_confidence_stays_when_a_repair_is_taken_back() -> None:
    s = session()
    s.label_editor.oracle = lambda region: 0.5
    s.merge([2, 3])
    s.use_oracle(None, dict.fromkeys(s.ids, 0.7))
    s.undo()
    assert s.objects.at[1, "confidence"] == 0.7


def score_missing(s: Session) -> None:
    task = s.label_editor.missing_scores_task()
    assert task is not None
    s.label_editor.take_scores(task.run(no_progress))
    assert s.label_editor.missing_scores_task() is None


def test_what_undo_and_redo_bring_back_is_scored_by_the_model_in_use() -> None:
    s = session()
    # What came with the labels is nobody's to replace.
    assert s.label_editor.missing_scores_task() is None
    s.merge([2, 3])
    (merged,) = {2, 3} & set(s.ids)
    s.use_oracle(lambda region: region.voxels / 5000, dict.fromkeys(s.ids, 0.7))
    s.undo()
    assert s.objects.confidence.isna().tolist() == [False, True, True]
    score_missing(s)
    voxels = s.objects.voxels
    assert s.objects.confidence.tolist() == [0.7, voxels[2] / 5000, voxels[3] / 5000]
    s.redo()
    score_missing(s)
    assert s.objects.confidence[merged] == s.objects.voxels[merged] / 5000
    # Undone far at once, as the viewer does it, and the model changed in between.
    s.split(1, LEFT, RIGHT)
    s.undo()
    task = s.queries.labels_task("undo")
    assert task is not None
    s.use_oracle(lambda region: 0.25, dict.fromkeys(s.ids, 0.25))
    # Of another model: it is refused, and undo goes by the one in use.
    assert not s.queries.store(task, task.run(no_progress))
    s.undo()
    score_missing(s)
    assert s.objects.confidence.tolist() == [0.25, 0.25, 0.25]


def test_labels_worked_out_beforehand_have_the_scores_of_now() -> None:
    s = session()
    s.merge([2, 3])
    s.split(1, LEFT, RIGHT)
    s.undo()
    s.use_oracle(lambda region: region.voxels / 5000, {})
    task = s.queries.labels_task("undo")
    assert task is not None
    data = task.run(no_progress)
    assert s.queries.store(task, data)
    score_missing(s)
    s.undo()
    assert s.labels is data.labels
    assert s.objects.confidence[1] == s.objects.voxels[1] / 5000
    score_missing(s)


def test_a_repaired_object_that_a_model_has_no_number_for_has_0_as_in_the_whole_table() -> None:
    s = session()
    s.use_oracle(lambda region: float("nan"), dict.fromkeys(s.ids, 0.5))
    s.merge([2, 3])
    assert sorted(s.objects.confidence) == [0.0, 0.5]
    assert s.label_editor.missing_scores_task() is None


def test_what_is_repaired_while_a_model_scores_is_scored_again() -> None:
    s = session()
    scores = s.label_editor.scores_task(lambda region: region.voxels / 5000).run(no_progress)
    new = s.split(1, LEFT, RIGHT)
    s.label_editor.take_scores(scores)
    confidence = s.objects.confidence
    assert confidence.isna().to_dict() == {1: True, 2: False, 3: False, new: True}
    score_missing(s)
    assert s.objects.confidence.tolist() == (s.objects.voxels / 5000).tolist()
    # What is missing of one model is no answer of the next.
    s.undo()
    s.redo()
    late = s.label_editor.scores_task(lambda region: 0.5).run(no_progress)
    s.undo()
    s.label_editor.take_scores(late)
    missing = s.label_editor.missing_scores_task()
    s.use_oracle(lambda region: 0.25, dict.fromkeys(s.ids, 0.25))
    assert missing is not None
    s.label_editor.take_scores(missing.run(no_progress))
    assert set(s.objects.confidence) == {0.25}
    # And a repair that was begun under the model before.
    edited = s.label_editor.merge_task([2, 3]).run(no_progress)
    s.use_oracle(lambda region: 0.75, dict.fromkeys(s.ids, 0.75))
    assert s.label_editor.apply(edited)
    score_missing(s)
    assert set(s.objects.confidence) == {0.75}


def test_labels_somebody_else_can_write_to_are_not_kept() -> None:
    s = session()
    given = s.labels
    s.merge([2, 3])
    s.own_labels([given])
    given[:] = 0
    s.undo()
    assert_consistent(s)
    assert s.ids == (1, 2, 3)


def test_what_people_set_goes_along_with_a_repair() -> None:
    made = session()
    made.rename(1, "Weight")
    new = made.split(1, LEFT, RIGHT)
    names = made.objects["name"]
    assert sorted(names[i] for i in (1, new)) == ["Weight", "Weight, part"]
    made.undo()

    made.measurements.add([SurfacePoint(2, (4, 16, 8)), SurfacePoint(3, (4, 16, 40))])
    made.merge([1, 2])
    (ruler,) = made.state.measurements
    assert [p.object_id for p in ruler.points] == [1, 3]
    made.undo()
    assert [p.object_id for p in made.state.measurements[0].points] == [2, 3]

    # A point of nothing stays one, whatever is painted; what nothing moved is the same as before.
    made.measurements.add([SurfacePoint(0, (1, 1, 1)), SurfacePoint(3, (4, 16, 40))])
    before = made.state.measurements
    made.split(1, LEFT, RIGHT)
    assert made.state.measurements is before


def test_what_is_said_of_an_object_goes_on_with_what_it_becomes_part_of() -> None:
    made, red, blue = session(), (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    said = made.annotations
    said.set_flag(2, "suspicious")
    said.set_flag([1, 3], "cleared")
    said.set_note(2, "wires")
    said.set_note(3, "ask the owner")
    said.set_color(2, red)
    made.rename(2, "Knife")
    # The plate has a note of its own, and neither name nor colour.
    assert made.merge([2, 3]) == 3
    assert said.flags == {1: "cleared", 3: "suspicious"}
    assert said.notes == {3: "ask the owner; wires"}
    assert (said.colors, made.state.names) == ({3: red}, {3: "Knife"})
    made.undo()
    assert said.flags == {1: "cleared", 2: "suspicious", 3: "cleared"}
    # What an object has of its own stays; what is undecided is not cleared with a part of it.
    made.rename(3, "Lid")
    said.set_color(3, blue)
    said.set_flag(1, None)
    made.merge([2, 3])
    assert (said.colors, made.state.names) == ({3: blue}, {3: "Lid"})
    said.set_flag(3, "cleared")
    assert made.merge([1, 3]) == 1
    assert said.flags == {}
    assert said.notes == {1: "ask the owner; wires"}


def test_what_a_brush_covers_up_leaves_nothing_to_its_neighbour() -> None:
    made = session()
    made.annotations.set_flag(2, "suspicious")
    made.annotations.set_note(2, "wires")
    made.annotations.set_color(2, (1.0, 0.0, 0.0, 1.0))
    made.rename(2, "Knife")
    # Erased but for one voxel, over which the neighbour is painted.
    for first, label in (((4, 16, 5), 0), ((4, 16, 4), 3)):
        painted = made.labels.copy()
        z, y, x = first
        painted[z:10, y:22, x:10][painted[z:10, y:22, x:10] == 2] = label
        if label == 0:
            painted[4, 16, 4] = 2
        made.label_editor.apply(made.label_editor.paint_task(painted).run(no_progress))
    assert made.ids == (1, 3)
    said = made.annotations
    assert (made.state.names, said.colors, said.notes, said.flags) == ({}, {}, {}, {})
    made.undo()
    assert made.state.names == {2: "Knife"}


def test_both_parts_of_a_suspicious_object_are_suspicious() -> None:
    made = session()
    made.annotations.set_flag(1, "suspicious")
    made.annotations.set_color(1, (1.0, 0.0, 0.0))
    new = made.split(1, LEFT, RIGHT)
    assert made.annotations.flags == {1: "suspicious", new: "suspicious"}
    assert made.annotations.colors.keys() == {1}
    made.undo()
    made.annotations.set_flag(1, "cleared")
    made.split(1, LEFT, RIGHT)
    assert made.annotations.flags == {1: "cleared"}


def test_a_part_of_a_hidden_object_is_hidden_and_has_its_note() -> None:
    made = session()
    made.annotations.set_note(1, "wires")
    made.hide(1)
    new = made.split(1, LEFT, RIGHT)
    assert made.states[new] is made.states[1] is ObjectState.HIDDEN
    assert made.states[2] is ObjectState.PACKED
    assert made.annotations.notes == {1: "wires", new: "wires"}
    made.show(1)
    assert made.states[new] is ObjectState.HIDDEN
    made.undo()
    made.undo()
    assert made.annotations.notes == {1: "wires"}


def test_a_new_label_that_is_painted_over_a_hidden_object_is_seen() -> None:
    made = session()
    made.hide([2, 3])
    painted = made.labels.copy()
    painted[4:6, 16:22, 4:10] = 7
    made.label_editor.apply(made.label_editor.paint_task(painted).run(no_progress))
    assert (made.labels == 7).sum() == 72
    assert made.states[7] is ObjectState.PACKED
    assert made.states[2] is made.states[3] is ObjectState.HIDDEN


def test_a_label_that_is_used_anew_has_nothing_of_the_deleted_object() -> None:
    made = session()
    made.set_style(2, ObjectStyle(TransferFunction([(0, 0), (900, 0.5)]), None))
    made.delete(2)
    assert 2 not in made.state.styles
    made.undo()
    assert 2 in made.state.styles


def test_a_point_beside_a_border_stays_with_the_voxel_that_it_is_on() -> None:
    before, spacing = np.ones((5, 5, 20), int), np.array([1.0, 1.0, 2.0])
    after = np.where(np.arange(20) < 12, before, 3)
    for x, owner in ((11.4, 1), (11.6, 3), (11, 1), (12, 3), (19.5, 3)):
        assert owner_after(SurfacePoint(1, (2, 2, 2 * x)), before, after, spacing) == owner
    # Above its face, over a voxel that is none of its own; and far from it.
    assert owner_after(SurfacePoint(1, (4.5, 2, 24)), before, after, spacing) == 3
    assert owner_after(SurfacePoint(2, (2, 2, 24)), before, after, spacing) == 2


def test_points_go_along_with_the_part_that_they_are_on() -> None:
    made = session()
    # On the outer face of either cube, and in the middle of the right one.
    left, right, inner = (8, 8, 2.5 * 2), (8, 8, 28.5 * 2), (8, 8, 24 * 2)
    made.measurements.add([SurfacePoint(1, left), SurfacePoint(1, right)])
    made.measurements.add([SurfacePoint(1, inner), SurfacePoint(2, (7, 18, 12))])
    new = made.split(1, LEFT, RIGHT)
    assert new == 4
    part = {place: int(made.labels[place]) for place in (LEFT, RIGHT)}
    across, within = made.state.measurements
    assert [p.object_id for p in across.points] == [part[LEFT], part[RIGHT]]
    assert [p.object_id for p in within.points] == [part[RIGHT], 2]
    made.undo()
    assert [p.object_id for m in made.state.measurements for p in m.points] == [1, 1, 1, 2]
