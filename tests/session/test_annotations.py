"""What a person says of objects: colours, notes and flags, undone, saved and shown everywhere."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from bags import session_of, stack_of_plates

from napari_unpack.appearance import TransferFunction, hue_distance
from napari_unpack.appearance.tints import OPACITY_POWER, nearest_hue, tints_of
from napari_unpack.geometry.transforms import packed_pose
from napari_unpack.io.headless import packed_copy, snapshot
from napari_unpack.io.session_json import record_of, session_from
from napari_unpack.rendering.compose import object_image, packed_image
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session import Session

RED = (1.0, 0.0, 0.0, 1.0)
CUT = np.zeros(3), np.array([0.0, 0.0, 1.0])


def two_balls() -> Session:
    z, y, x = np.indices((20, 20, 40))
    labels = np.zeros((20, 20, 40), np.uint16)
    for i, center in ((1, 10), (2, 30)):
        labels[(z - 10) ** 2 + (y - 10) ** 2 + (x - center) ** 2 < 70] = i
    made = Session(1000.0 * (labels > 0), labels)
    made.backend = "cpu"
    return made


def test_an_own_colour_is_in_every_table_of_tints_and_taken_back() -> None:
    session, heard = session_of(stack_of_plates()), []
    session.events.hues.connect(heard.append)
    automatic = session.packed_tints().copy()
    session.annotations.set_color([2, 3], (1.0, 0.5, 0.0, 0.5))
    assert len(heard) == 1
    thin = 0.5**OPACITY_POWER
    np.testing.assert_allclose(session.packed_tints()[2:4], [(1, 0.5, 0, thin)] * 2)
    np.testing.assert_allclose(session.solo_tints(2)[2, :3], (1, 0.5, 0))
    np.testing.assert_array_equal(session.packed_tints()[[1, 4, 5]], automatic[[1, 4, 5]])
    for copied in (packed_copy(session), snapshot(session)):
        np.testing.assert_array_equal(copied.packed_tints(), session.packed_tints())
    session.annotations.set_color(2, None)
    np.testing.assert_array_equal(session.packed_tints()[2], automatic[2])
    session.undo()
    session.undo()
    np.testing.assert_array_equal(session.packed_tints(), automatic)
    session.redo()
    assert session.annotations.colors == dict.fromkeys((2, 3), (1.0, 0.5, 0.0, 0.5))
    with pytest.raises(ValueError, match="color must be three or four numbers from 0 to 1"):
        session.annotations.set_color(2, (1.0, 2.0, 0.0))


def test_the_picture_of_the_bag_and_of_an_object_alone_are_in_the_own_colour() -> None:
    session = two_balls()
    session.annotations.set_color(1, RED)
    camera, size = session.camera, (40, 80)
    pose = packed_pose(session.boxes.center(1, session.spacing), camera)
    alone = object_image(session.scene(), 1, pose, camera, size).rgba
    bag = packed_image(session.scene(), camera, size).rgba
    for rgba in (alone, bag):
        seen = rgba[rgba[..., 0] > 0.4]
        assert len(seen) > 50
        assert np.all(seen[:, 0] > 2 * seen[:, 1])
    opaque = alone[..., 3].max()
    session.annotations.set_color(1, (1.0, 0.0, 0.0, 0.3))
    faint = object_image(session.scene(), 1, pose, camera, size).rgba
    assert faint[..., 3].max() < 0.7 * opaque


def test_hues_of_neighbours_keep_away_from_an_own_colour() -> None:
    labels = np.zeros((4, 6, 12), np.uint16)
    for i in range(3):
        labels[1:3, 1:5, 4 * i : 4 * i + 4] = i + 1
    session = session_of(labels)
    before = session.recolor()
    blue = tuple(tints_of({1: before[1]}, 1)[1])
    session.annotations.set_color(2, blue)
    hues = session.recolor()
    assert hue_distance(hues[2], before[1]) < 0.01
    assert hue_distance(hues[1], hues[2]) > 0.1
    assert hue_distance(hues[3], hues[2]) > 0.1


@pytest.mark.parametrize("mode", ["perceptual", "safe", "hsv"])
def test_the_nearest_hue_of_a_tint_is_its_own(mode: str) -> None:
    for hue in (0.0, 0.2, 0.55, 0.9):
        assert hue_distance(nearest_hue(tuple(tints_of({1: hue}, 1, mode=mode)[1]), mode), hue) < (
            0.005
        )


def test_notes_and_flags_are_undone_and_in_the_table() -> None:
    session, heard = session_of(stack_of_plates()), []
    session.events.states.connect(heard.append)
    assert "note" not in session.objects
    session.annotations.set_note(2, "  looks like a knife ")
    session.annotations.set_flag([2, 4], "suspicious")
    session.annotations.set_flag(4, "cleared")
    assert heard == [{2}, {2, 4}, {4}]
    assert session.objects["note"].to_dict()[2] == "looks like a knife"
    assert session.objects["flag"].tolist() == ["", "suspicious", "", "cleared", ""]
    session.annotations.set_flag(4, None)
    session.annotations.set_note(2, " ")
    assert "note" not in session.objects
    session.undo()
    assert session.annotations.notes == {2: "looks like a knife"}
    for _ in range(4):
        session.undo()
    assert not session.annotations.flags
    assert not session.annotations.notes
    with pytest.raises(ValueError, match="suspicious, cleared"):
        session.annotations.set_flag(4, "odd")


def test_what_is_said_of_objects_is_in_saved_sessions_and_older_files_open() -> None:
    session = session_of(stack_of_plates())
    session.annotations.set_color(3, (0.2, 0.4, 0.6, 0.8))
    session.annotations.set_note(1, "ask the owner")
    session.annotations.set_flag(5, "cleared")
    record = json.loads(json.dumps(record_of(session)))
    again = session_from(record, session.volume, session.labels).annotations
    assert (again.colors, again.notes, again.flags) == (
        {3: (0.2, 0.4, 0.6, 0.8)},
        {1: "ask the owner"},
        {5: "cleared"},
    )
    for key, wrong in (("colors", [2.0, 0, 0, 1]), ("flags", "odd")):
        broken = json.loads(json.dumps(record))
        broken["situation"][key] = {"3": wrong}
        with pytest.raises(ValueError, match=rf"situation\.{key}"):
            session_from(broken, session.volume, session.labels)
    for key in ("colors", "notes", "flags"):
        del record["situation"][key]
    assert session_from(record, session.volume, session.labels).annotations.colors == {}


def test_what_is_said_of_objects_leaves_with_them_and_undo_brings_it_back() -> None:
    session = session_of(stack_of_plates())
    session.annotations.set_color(3, RED)
    session.annotations.set_note(3, "a note")
    session.delete(3)
    assert not session.annotations.colors
    session.undo()
    assert session.annotations.colors == {3: RED}
    assert session.annotations.notes == {3: "a note"}


def test_a_cut_ends_with_the_inspection_and_an_opacity_curve_stays() -> None:
    session = session_of(stack_of_plates())
    session.unpack([1])
    session.inspect(1)
    steps = len(session.history.done)
    session.set_style(1, ObjectStyle(cut=CUT))
    assert session.style(1).cut is not None
    # A way of looking, which is no step of undo.
    assert len(session.history.done) == steps
    session.leave()
    assert session.style(1).cut is None
    own = TransferFunction([(0, 0), (500, 0.4)])
    session.inspect(1)
    session.set_style(1, ObjectStyle(own, CUT))
    session.inspect(2)
    assert session.style(1).cut is None
    assert session.style(1).transfer_function == own
    session.restore([1])
    # A film shows objects as the view does.
    assert packed_copy(session).style(1).transfer_function == own
    session.undo()
    session.undo()
    assert session.style(1).transfer_function is None


@pytest.mark.parametrize("leave", ["hide", "restore", "go_to", "undo", "unpack"])
def test_however_an_inspection_ends_its_cut_ends_too(leave: str) -> None:
    session = session_of(stack_of_plates())
    session.unpack(1)
    first = next(iter(session.state.placements))
    session.inspect(first)
    session.set_style(first, ObjectStyle(cut=CUT))
    {
        "hide": lambda: session.hide([first]),
        "restore": session.restore,
        "go_to": lambda: session.go_to(0),
        "undo": session.undo,
        "unpack": session.unpack,
    }[leave]()
    assert session.state.inspected is None
    assert session.style(first).cut is None


def test_names_of_another_program_that_are_blank_leave_objects_theirs() -> None:
    session = session_of(stack_of_plates())
    session.rename(1, "plate")
    session.annotations.name_and_color({1: "  ", 2: " lid "}, {1: (1, 0, 0)})
    assert session.objects["name"][[1, 2]].tolist() == ["plate", "lid"]
    assert session.annotations.colors.keys() == {1}


def test_a_name_is_one_line_wherever_it_comes_from() -> None:
    labels = stack_of_plates()
    odd = "plate\nof\tglass \r\n "
    for given in ({"name": [odd] * 2}, {"kind": [odd] * 2}):
        table = pd.DataFrame(given, index=[1, 2])
        names = Session(labels, labels, objects=table).objects["name"]
        assert [name.lower().rstrip(" 12") for name in names[[1, 2]]] == ["plate of glass"] * 2
    session = session_of(stack_of_plates())
    session.rename(1, odd)
    session.annotations.name_and_color({2: odd}, {})
    record = json.loads(json.dumps(record_of(session)))
    record["situation"]["names"]["3"] = odd
    again = session_from(record, session.volume, session.labels)
    assert again.objects["name"][[1, 2, 3]].tolist() == ["plate of glass"] * 3
    with pytest.raises(ValueError, match="must not be blank"):
        session.rename(1, "\n\t")


@pytest.mark.parametrize("column", ["name", "kind"])
def test_a_blank_name_in_a_table_is_none(column: str) -> None:
    labels = stack_of_plates()
    table = pd.DataFrame({column: [" \n ", "", "plate"]}, index=[1, 2, 3])
    names = Session(labels, labels, objects=table).objects["name"]
    assert names[[1, 2]].tolist() == ["Object 1", "Object 2"]
    assert names[3].lower().startswith("plate")
