"""What a session is given: refused at the door where it cannot be, and nobody's to change later."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bags import session_of, stack_of_plates
from skimage.measure import regionprops_table

import napari_unpack as nu
from napari_unpack.geometry.transforms import Pose
from napari_unpack.io import save_objects_csv
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session import Session
from napari_unpack.session.bag_cut import Cutting
from napari_unpack.session.containers import open_container
from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.session.state import UnpackingRules

NAN = float("nan")
EYE = np.eye(3)


@pytest.fixture
def session() -> Session:
    """A bag of plates 1 to 5, of which 1 and 2 are out."""
    session = session_of(stack_of_plates())
    session.unpack(2)
    return session


def outside(session: Session) -> int:
    return next(iter(session.poses))


def placed(**changes: Any) -> Callable[[Session], None]:
    def place(session: Session) -> None:
        i = outside(session)
        session.place(i, replace(session.poses[i], **changes))

    return place


def turned(rotation: Any) -> Callable[[Session], None]:
    return lambda session: session.turn(outside(session), rotation)


def sets(name: str, value: Any) -> Callable[[Session], None]:
    return lambda session: setattr(session, name, value)


def measured(object_id: Any) -> Callable[[Session], None]:
    points = (0.0, 0.0, 0.0), (0.0, 0.0, 5.0)
    return lambda session: session.measurements.add([SurfacePoint(object_id, at) for at in points])


def cuts(*cut: Any) -> Callable[[Session], None]:
    return lambda session: session.set_style(1, ObjectStyle(None, cut))


@pytest.mark.parametrize("density", [0.0, 1000.0, -2e38])
def test_labels_that_leave_no_background_are_unpacked_without_an_image(density: float) -> None:
    labels = np.ones((3, 4, 6), np.uint8)
    labels[..., 3:] = 2
    session = Session(np.full(labels.shape, density), labels)
    session.backend = "cpu"
    assert session.transfer_function.opacity_at(density) > 0.5
    assert session.unpack(2) == (1, 2)


REFUSED: dict[str, tuple[str, Callable[[Session], Any]]] = {
    "turn larger": ("rotation", turned(2 * EYE)),
    "turn mirrored": ("rotation", turned(np.diag([1.0, 1.0, -1.0]))),
    "turn to nothing": ("rotation", turned(np.zeros((3, 3)))),
    "turn NaN": ("rotation", turned(np.full((3, 3), NAN))),
    "turn 2 x 2": ("rotation", turned(np.eye(2))),
    "turn None": ("rotation", turned(None)),
    "look at a turn": ("rotation", lambda s: s.pose_turned(outside(s), 2 * EYE)),
    "place mirrored": ("scale", placed(scale=-1.0)),
    "place at no size": ("scale", placed(scale=0.0)),
    "place at NaN size": ("scale", placed(scale=NAN)),
    "place at NaN": ("center", placed(center=np.array([NAN, 0.0, 0.0]))),
    "place in a plane": ("center", placed(center=np.zeros(2))),
    "place turned": ("rotation", placed(rotation=2 * EYE)),
    "place None": ("pose", lambda s: s.place(outside(s), None)),
    "hue None": ("hue of object 1", lambda s: s.apply_hues({1: None})),
    "hue NaN": ("hue of object 1", lambda s: s.apply_hues({1: NAN})),
    "hue 1": ("hue of object 1", lambda s: s.apply_hues({2: 0.5, 1: 1.0})),
    "hue below 0": ("hue of object 1", lambda s: s.apply_hues({1: -0.1})),
    "margin None": ("hue_margin", sets("hue_margin", None)),
    "margin a": ("hue_margin", sets("hue_margin", "a")),
    "margin NaN": ("hue_margin", sets("hue_margin", NAN)),
    "margin below 0": ("hue_margin", sets("hue_margin", -1)),
    "margin 2": ("hue_margin", sets("hue_margin", 2)),
    "point on -1": ("object_id", measured(-1)),
    "point on a part": ("object_id", measured(1.5)),
    "point on nobody": ("points", measured(99)),
    "unit None": ("length_unit", sets("length_unit", None)),
    "unit 3": ("length_unit", sets("length_unit", 3)),
    "rules None": ("rules", sets("rules", None)),
    "surroundings None": ("decorations", sets("decorations", None)),
    "seconds a": ("seconds", sets("seconds", "a")),
    "backend foo": ("backend", sets("backend", "foo")),
    "backend None": ("backend", sets("backend", None)),
    "half a step": ("step", lambda s: s.go_to(2.5)),
    "step True": ("step", lambda s: s.go_to(True)),
    "step NaN": ("step", lambda s: s.go_to(NAN)),
    "step below 0": ("step", lambda s: s.go_to(-1)),
    "name None": ("name", lambda s: s.rename(3, None)),
    "note None": ("text", lambda s: s.annotations.set_note(3, None)),
    "label of a stranger": ("object_id", lambda s: s.label_of(99)),
    "label of -1": ("object_id", lambda s: s.label_of(-1)),
    "label of 1.5": ("object_id", lambda s: s.label_of(1.5)),
    "tolerance of text": ("tolerance must be a number", sets("tolerance", "0.1")),
    "groups of 2.7": ("max_group_size must be a whole", sets("max_group_size", 2.7)),
    "groups of True": ("max_group_size must be a whole", sets("max_group_size", True)),
    "least of text": ("take_least_occluded must be True", sets("take_least_occluded", "False")),
    "least of 1": ("take_least_occluded must be True", sets("take_least_occluded", 1)),
    "rules of text": ("take_least_occluded", lambda s: UnpackingRules(take_least_occluded="no")),
    "unpack True": ("n_or_ids must be object IDs", lambda s: s.unpack(True)),
    "unpack 2.0": ("n_or_ids must be object IDs", lambda s: s.unpack(2.0)),
    "unpack an array of none": ("n_or_ids must be", lambda s: s.unpack(np.array(2))),
    "hide an array of none": ("^ids must be object IDs", lambda s: s.hide(np.array(3))),
    "hide None": ("^ids must be object IDs", lambda s: s.hide(None)),
    "open a stranger": ("object_id must be", lambda s: open_container(s, 99)),
    "open a stranger again": ("object_id must be", lambda s: s.opened_bags.open(s, 99)),
    "look larger": ("rotation", lambda s: s.look(replace(s.camera, rotation=2 * EYE))),
    "look mirrored": ("rotation", lambda s: s.look(replace(s.camera, rotation=-EYE))),
    "look skewed": ("stretch", lambda s: s.look(replace(s.camera, stretch=np.tri(3)))),
    "look stretched": ("stretch", lambda s: s.look(replace(s.camera, stretch=2 * EYE))),
    "window too wide": ("canvas_size must be", sets("canvas_size", (70_000, 10))),
    "window of 5": ("canvas_size must be", sets("canvas_size", (5,))),
    "window 5": ("canvas_size must be", sets("canvas_size", 5)),
    "window of halves": ("canvas_size must be", sets("canvas_size", (10.5, 20))),
    "style soft": ("style must be", lambda s: s.set_style(1, "soft")),
    "cut across nothing": ("normal that is not 0", cuts((0, 0, 0), (0, 0, 0))),
    "cut at NaN": ("cut of the style must be", cuts((NAN, 0, 0), (0, 0, 1))),
    "cut of a point": ("cut of the style must be", cuts((1, 2, 3))),
    "first voxel in a plane": ("first_voxel_mm must be", sets("first_voxel_mm", (1, 2))),
    "scanner of 3": ("scanner_from_scan must be", sets("scanner_from_scan", EYE)),
    "scanner with the voxel size": (
        "scanner_from_scan must tell .* without the voxel size",
        sets("scanner_from_scan", np.diag([3.0, 1.0, 1.0, 1.0])),
    ),
    "colour red": ("color must be three or four", lambda s: s.annotations.set_color(1, "red")),
    "colour 5": ("color must be three or four", lambda s: s.annotations.set_color(1, 5)),
    "tints of a stranger": ("object_id must be objects of", lambda s: s.solo_tints(77)),
    "curve of a stranger": ("object_id must be objects", lambda s: s.transfer_function_of(77)),
    "lock a stranger": ("locked_hues must be objects", sets("locked_hues", [99])),
    "names of 5": ("name must be", lambda s: s.annotations.name_and_color({1: "a", 2: 5}, {})),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_by_name_and_changes_nothing(case: str, session: Session) -> None:
    name, act = REFUSED[case]

    def held() -> tuple[object, ...]:
        s = session
        return s.state, s.view_state, s.rules, s.seconds, s.backend, *s.history.done

    before = held()
    with pytest.raises((ValueError, TypeError), match=name):
        act(session)
    assert [*map(id, held())] == [*map(id, before)]


@pytest.mark.parametrize("given", [[3, 4], [3], [], (), "3", 3.0, None, True], ids=repr)
@pytest.mark.parametrize(
    "verb",
    [
        lambda s, i: s.rename(i, "a shoe"),
        lambda s, i: s.annotations.set_note(i, "a shoe"),
        lambda s, i: s.inspect(i),
        lambda s, i: s.force_unpack(i),
        lambda s, i: s.reveal(i),
        lambda s, i: s.reveal_plan(i),
        lambda s, i: s.turn(i, EYE),
    ],
    ids=["rename", "set_note", "inspect", "force_unpack", "reveal", "reveal_plan", "turn"],
)
def test_a_verb_for_one_object_takes_one_integer(verb, given, session: Session) -> None:
    before = session.state
    with pytest.raises(TypeError, match="object_id must be one object ID"):
        verb(session, given)
    assert session.state is before


def test_a_verb_for_one_object_takes_integers_of_numpy(session: Session) -> None:
    session.rename(np.uint16(3), "a shoe")
    session.inspect(np.int64(3))
    assert session.objects.name[3] == "a shoe"
    assert session.state.inspected == 3


def test_numbers_of_numpy_become_plain(session: Session) -> None:
    i = outside(session)
    session.turn(i, EYE.tolist())
    session.apply_hues({np.int64(1): np.float32(0.25)})
    session.hue_margin = np.float32(0.25)
    session.seconds = np.float32(0.5)
    session.rules = UnpackingRules("exact", np.float32(0.25), np.int64(3), np.True_)
    told = [*session.hues.values(), session.hue_margin, session.seconds, *session.rules.terms[1:]]
    assert {type(v) for v in told} == {float, int, bool}
    np.testing.assert_array_equal(session.poses[i].rotation, EYE)


def test_hues_of_objects_that_are_gone_may_stay_locked(session: Session) -> None:
    session.locked_hues = [4]
    session.delete(4)
    session.locked_hues |= {3}
    assert session.locked_hues == {3, 4}


def test_a_margin_that_was_refused_leaves_hues_that_separate(session: Session) -> None:
    with pytest.raises(ValueError, match="hue_margin"):
        session.hue_margin = NAN
    assert np.isfinite(list(session.recolor().values())).all()


COLUMNS = ("confidence", "z", "y", "x", "voxels", "volume_mm3", "mean_density")


@pytest.mark.parametrize("column", COLUMNS)
def test_a_table_with_words_for_numbers_is_refused(column: str) -> None:
    table = pd.DataFrame({column: [0.5, "high", None, 1, 1]}, index=range(1, 6))
    with pytest.raises(ValueError, match=f"column '{column}' of objects .* got 'high'"):
        session_of(stack_of_plates(), objects=table)


@pytest.mark.parametrize("columns", [["a", "a"], [("a", "b"), ("a", "c")]], ids=repr)
def test_a_table_whose_columns_have_no_name_of_their_own_is_refused(columns: Any) -> None:
    names = pd.MultiIndex.from_tuples(columns) if columns[0] != "a" else columns
    table = pd.DataFrame([[1, 2]] * 5, index=range(1, 6), columns=names)
    with pytest.raises(ValueError, match="objects must have one name for each column"):
        session_of(stack_of_plates(), objects=table)


def test_numbers_among_nothing_stay_numbers() -> None:
    table = pd.DataFrame({"confidence": [0.5, None, 1, "0.25", np.nan]}, index=range(1, 6))
    found = session_of(stack_of_plates(), objects=table.astype(object)).objects.confidence
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, [0.5, NAN, 1.0, 0.25, NAN])


@pytest.mark.parametrize("names", [[1, 2, 3, 4, 5], [1.0, 2.0, None, 4.0, 5.0]], ids=repr)
def test_numbers_in_the_table_serve_as_names(names: list[Any]) -> None:
    table = pd.DataFrame({"name": names}, index=range(1, 6))
    session = session_of(stack_of_plates(), objects=table)
    session.rename(2, "a shoe")
    third = "Object 3" if names[2] is None else "3"
    assert session.objects.name.tolist() == ["1", "a shoe", third, "4", "5"]


def test_a_table_read_from_a_file_is_known_by_its_column_id(tmp_path: Path) -> None:
    names = {4: "tray", 2: "lid", 1: "cup", 5: "dish"}
    table = pd.DataFrame({"name": names}).rename_axis("id")
    read = pd.read_csv(save_objects_csv(table, tmp_path / "objects.csv"))
    for given in (read, read[read["name"] != "tray"]):
        objects = session_of(stack_of_plates(), objects=given).objects
        assert objects["name"].to_dict() == {1: "cup", 2: "lid", 3: "Object 3", 5: "dish"} | {
            4: "tray" if given is read else "Object 4"
        }
        assert "id" not in objects
    # A person's own, beside IDs that are called so.
    own = table.assign(id=[7, 8, 9, 10])
    for given in (own, own.rename_axis(None)):
        assert session_of(stack_of_plates(), objects=given).objects.loc[4, "id"] == 7
    batches = pd.DataFrame({"name": [*"abc"], "id": [1, 1, 2]}, index=[1, 2, 3])
    assert session_of(stack_of_plates(), objects=batches).objects.loc[2, "name"] == "b"
    with pytest.raises(ValueError, match="each ID once"):
        session_of(stack_of_plates(), objects=pd.concat([read, read], ignore_index=True))
    with pytest.raises(TypeError, match=r"objects must be a DataFrame .*, got dict: pandas"):
        session_of(stack_of_plates(), objects={"id": [5]})


@pytest.mark.parametrize("column", ["id", "label"])
def test_a_table_of_a_part_of_the_objects_and_of_others_is_known_by_its_column(column: str) -> None:
    # 9 has gone from the labels since, or lies outside them.
    table = pd.DataFrame({column: [2, 3, 4, 9], "name": ["lid", "pan", "tray", "lamp"]})
    blank = pd.concat([table, pd.DataFrame({"name": ["?", "?"]})], ignore_index=True)
    # Of an index that may be the IDs as well, only `id` leaves no doubt.
    doubtful = (table.drop(index=0), table.set_index(pd.Index([1, 2, 3, 4])))
    for given in (table, blank, *(doubtful if column == "id" else ())):
        objects = session_of(stack_of_plates(), objects=given).objects
        lid = "lid" if 2 in given[column].tolist() else "Object 2"
        assert objects["name"].tolist() == ["Object 1", lid, "pan", "tray", "Object 5"]


def test_a_table_as_scikit_image_measures_it_is_known_by_its_column_label() -> None:
    bag = stack_of_plates()
    table = pd.DataFrame(regionprops_table(bag, properties=("label", "area")))
    objects = session_of(bag, objects=table).objects
    assert objects["area"].tolist() == objects["voxels"].tolist()
    # A person's own, beside the objects' IDs.
    own = pd.DataFrame({"label": [2, 3, 4, 5, 6]}, index=range(1, 6))
    assert session_of(bag, objects=own).objects["label"].tolist() == [2, 3, 4, 5, 6]


def test_a_table_that_may_have_its_ids_in_two_places_is_refused() -> None:
    bag = stack_of_plates()
    table = pd.DataFrame({"label": [2, 1], "kind": ["cup", "box"]}, index=[1, 3])
    with pytest.raises(ValueError, match="where its IDs are, got some in its index and others"):
        session_of(bag, objects=table)
    said = session_of(bag, objects=table.rename_axis("id")).objects["kind"]
    assert said[[1, 3]].tolist() == ["cup", "box"]
    said = session_of(bag, objects=table.set_index("label")).objects["kind"]
    assert said[[2, 1]].tolist() == ["cup", "box"]


def test_a_table_of_another_session_is_known_by_the_ids_people_know() -> None:
    bag = stack_of_plates().astype(np.int64) * 100_000
    table = session_of(bag).objects[["label", "mean_density"]].assign(kind=[*"abcde"])
    table.index = table.index + 1_000
    table = table[::-1].rename_axis("id")
    assert session_of(bag, objects=table).objects["kind"].tolist() == [*"abcde"]


@pytest.mark.parametrize("ids", [None, [True, False, True], [0.5, 1, 2], [7, 8, 9]], ids=repr)
def test_a_table_whose_rows_are_counted_from_0_is_refused(ids: Any) -> None:
    table = pd.DataFrame({"name": [*"abc"]} | ({} if ids is None else {"id": ids}))
    with pytest.raises(ValueError, match="rows counted from 0, which is no object: use"):
        session_of(stack_of_plates(), objects=table)


def test_a_name_made_of_a_kind_keeps_its_letters_but_for_the_first() -> None:
    table = pd.DataFrame({"kind": ["iPhone", "TV remote", "shoe", None, " "]}, index=range(1, 6))
    names = session_of(stack_of_plates(), objects=table).objects.name.tolist()
    assert names == ["IPhone 1", "TV remote 2", "Shoe 3", "Object 4", "Object 5"]


# Whose arrays they are.


def test_an_array_given_is_not_the_sessions(session: Session) -> None:
    spacing = np.ones(3)
    bag = nu.Session(session.volume, session.labels, spacing)
    spacing *= 0.5
    assert bag.spacing.tolist() == [1, 1, 1]
    i = outside(session)
    rotation = EYE.copy()
    session.turn(i, rotation)
    rotation[:] = 0
    assert session.poses[i].rotation.tolist() == EYE.tolist()
    pose = Pose(np.array([0.0, 3.0, 4.0]), EYE.copy())
    session.place(i, pose)
    pose.center[:] = pose.rotation[:] = 0
    assert session.poses[i].center.tolist() == [0, 3, 4]
    assert session.poses[i].rotation.tolist() == EYE.tolist()


def test_a_camera_given_is_not_the_sessions(session: Session) -> None:
    center = np.array([1.0, 2.0, 3.0])
    session.look(replace(session.camera, center=center, height=np.float32(80)))
    center += 100
    assert session.camera.center.tolist() == [1, 2, 3]
    assert type(session.camera.height) is type(session.view.height) is float


def cut(session: Session) -> Cutting:
    session.cutting.plane = [(4, 3, 3), (1, 0, 0)]
    session.cutting.box = [(1, 1, 1), (9, 5, 5)]
    return session.cutting


HANDED_OUT: dict[str, Callable[[Session], np.ndarray]] = {
    "spacing": lambda s: s.spacing,
    "slots": lambda s: s.slots.centers,
    "where a sprite is": lambda s: s.poses[outside(s)].center,
    "how a sprite is held": lambda s: s.poses[outside(s)].rotation,
    "along which it left": lambda s: s.state.placements[outside(s)].direction,
    "D": lambda s: s.unpack_direction,
    "middle of the view": lambda s: s.camera.center,
    "turn of the view": lambda s: s.camera.rotation,
    "stretch of the view": lambda s: s.camera.stretch,
    "up": lambda s: s.away_from_table,
    "cutting plane": lambda s: cut(s).plane,
    "clipping box": lambda s: cut(s).box,
}


@pytest.mark.parametrize("direction", [None, "up", "+z"])
@pytest.mark.parametrize("what", HANDED_OUT)
def test_what_a_session_hands_out_cannot_be_written_to(
    what: str, direction: str | None, session: Session
) -> None:
    session.direction = direction
    with pytest.raises(ValueError, match="read-only"):
        HANDED_OUT[what](session)[:] = 7


def test_a_session_is_not_copied(session: Session) -> None:
    with pytest.raises(TypeError, match="save_session"):
        copy.copy(session)
    with pytest.raises(TypeError, match="save_session"):
        copy.deepcopy(session)
