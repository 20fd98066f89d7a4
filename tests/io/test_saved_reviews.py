"""A review goes on in a reopened session; damaged evidence is refused with a sentence."""

import json

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.io.answers import answers_from, answers_record, save_answers
from napari_unpack.io.headless import snapshot
from napari_unpack.io.json_fields import Fields
from napari_unpack.io.recovery import UnsavedCopy
from napari_unpack.segmentation.review.evidence import Evidence


def reviewed() -> nu.Session:
    """Return a session of three blocks with a join and a border to ask about, one answered."""
    labels = np.zeros((8, 8, 32), np.int32)
    pieces = labels.copy()
    for k, label in enumerate((1, 1, 2)):
        pieces[1:7, 1:7, 1 + 10 * k : 11 + 10 * k] = k + 1
        labels[1:7, 1:7, 1 + 10 * k : 11 + 10 * k] = label
    session = nu.Session((1000 * (labels > 0)).astype(np.uint16), labels)
    sums = np.array([[0, 0, 0, 0, 0], *[[360, 360, 360, 300, 50]] * 3], float)
    contact = np.full((2, 3), 36.0)
    session.review.evidence = Evidence.of(
        pieces, sums, np.array([[1, 2], [2, 3]]), contact, np.array([0.3, 0.4]),
        np.array([True, False]),
    )  # fmt: skip
    found = session.review.doubts_task().run(lambda *_: None)
    first = found[0]
    edited = session.review.answer_task(first, "different").run(lambda *_: None)
    assert session.review.apply(first, "different", edited)
    return session


def test_a_review_goes_on_in_a_reopened_session(tmp_path) -> None:
    session = reviewed()
    again = nu.open_session(nu.save_session(session, tmp_path / "bag.unpack"))
    assert again.review.answers == session.review.answers
    assert len(again.review.answers) == 1
    asked = [s.review.doubts_task().run(lambda *_: None) for s in (session, again)]
    assert [d.pieces for d in asked[0]] == [d.pieces for d in asked[1]]
    assert np.array_equal(again.labels, session.labels)


def test_a_review_goes_on_after_a_crash(tmp_path) -> None:
    session, kept = reviewed(), UnsavedCopy(tmp_path)
    kept.keep(snapshot(session), "bag", None, lambda done: None)
    (folder,) = tmp_path.glob("*/*/session.json")
    again = nu.open_session(folder.parent)
    asked = [s.review.doubts_task().run(lambda *_: None) for s in (session, again)]
    assert [d.pieces for d in asked[0]] == [d.pieces for d in asked[1]]
    assert again.review.answers == session.review.answers
    kept.close()


def test_a_question_about_what_has_changed_is_refused_until_that_is_undone() -> None:
    session = reviewed()
    session.undo()
    review, silent = session.review, lambda *_: None
    join, border = review.doubts_task().run(silent)[:2]
    assert (join.kind, border.kind) == ("join", "border")
    session.split(1, (4, 4, 2), (4, 4, 15))
    for task in (review.answer_task(join, "different"), review.answer_task(border, "same")):
        with pytest.raises(ValueError, match="have changed since it was asked"):
            task.run(silent)
    session.delete([border.objects[0]])
    with pytest.raises(ValueError, match="have changed since it was asked"):
        review.picture_task(border, 40).run(silent)
    session.undo()
    session.undo()
    edited = review.answer_task(border, "same").run(silent)
    assert review.apply(border, "same", edited)
    assert session.ids == (1,)


def test_an_answer_and_its_repair_are_one_step_of_undo() -> None:
    session = reviewed()
    labels = session.labels
    session.undo()
    assert session.review.answers == ()
    session.redo()
    assert len(session.review.answers) == 1
    assert np.array_equal(session.labels, labels)


def test_sessions_without_a_review_open_as_before(tmp_path) -> None:
    labels = np.pad(np.ones((4, 4, 4), np.int32), 2)
    path = nu.save_session(nu.Session(labels.astype(np.uint16) * 900, labels), tmp_path / "bag")
    manifest = json.loads((path / "session.json").read_text())
    assert "evidence" not in manifest
    del manifest["session"]["situation"]["answers"]
    (path / "session.json").write_text(json.dumps(manifest))
    again = nu.open_session(path)
    assert again.review.answers == ()
    assert again.review.doubts_task() is None
    with pytest.raises(ValueError, match="there are no answers to save"):
        save_answers(again, tmp_path / "answers.npz")


def test_evidence_of_other_pieces_is_refused(tmp_path) -> None:
    path = nu.save_session(reviewed(), tmp_path / "bag")
    manifest = json.loads((path / "session.json").read_text())
    manifest["evidence"]["pairs"][0] = [1, 9]
    (path / "session.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match="evidence must be of pieces from 0 to 3"):
        nu.open_session(path)


def test_answers_are_plain_data() -> None:
    answers = reviewed().review.answers
    record = json.loads(json.dumps({"answers": answers_record(answers)}))
    assert answers_from(Fields(record, "situation")) == answers
