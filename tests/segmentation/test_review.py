"""A person's review: what is doubtful, what an answer changes, and what it teaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.common.joins import JoinLog, Level, Seen, Steps
from napari_unpack.segmentation.repair import edit_of_answer
from napari_unpack.segmentation.review.doubts import Answer, Doubt, Said, doubts
from napari_unpack.segmentation.review.evidence import Evidence, gather
from napari_unpack.segmentation.review.rescoring import FEATURES, Rescoring

SHAPE = (10, 10, 40)


def bars() -> tuple[np.ndarray, np.ndarray]:
    """Return four bars in a row, 1 to 4, and labels in which 1 and 2 are one, 3 and 4 two."""
    parts = np.zeros(SHAPE, np.int32)
    for k in range(4):
        parts[:, :, 10 * k : 10 * k + 10] = k + 1
    return parts, np.array([0, 1, 1, 2, 3], np.int32)[parts]


def evidence(join: float = 0.4, apart: float = 0.3, matter: int = 255) -> Evidence:
    """Return the evidence of those bars: 1 and 2 joined with a probability, 3 and 4 not."""
    parts, labels = bars()
    log = JoinLog([(1, 2, join)], {(3, 4): apart, (1, 3): 0.01})
    touching = np.array([[1, 2], [2, 3], [3, 4]]), np.full(3, 100.0)
    density = np.array([0, 1000, 1400, 900, 1000])[parts]
    seen = Seen(density, DensityScale(0.0, 250.0), np.full(SHAPE, matter, np.uint8))
    found = gather(labels, Steps([Level.of(log, parts, *touching)], seen))
    assert found is not None
    return found


def asked(kind: str, of: list[Doubt]) -> Doubt:
    """Return the first doubt of a kind."""
    return next(d for d in of if d.kind == kind)


def after(doubt: Doubt, said, labels: np.ndarray, found: Evidence) -> np.ndarray:
    """Return labels after an answer."""
    edit = edit_of_answer(doubt, said, found, labels, label_boxes(labels), int(labels.max()) + 1)
    return labels if edit is None else edit.apply(labels)


def test_a_sure_join_leaves_one_piece_and_a_doubtful_one_two() -> None:
    assert len(evidence(join=0.99).sums) == 1 + 3
    found = evidence(join=0.4)
    assert len(found.sums) == 1 + 4
    assert found.sums[1:, 0].tolist() == [1000.0] * 4
    assert found.chance[found.tree].tolist() == [0.4]
    assert np.array_equal(found.pieces > 0, bars()[0] > 0)


def test_an_answer_cuts_where_the_decision_was_joins_or_deletes() -> None:
    found, (parts, labels) = evidence(), bars()
    left = doubts(found, labels, share=2.0)
    join, border = asked("join", left), asked("border", left)
    assert join.objects == (1, 1)
    assert set(border.objects) == {2, 3}
    cut = after(join, "different", labels, found)
    assert len(np.unique(cut)) == 4
    assert np.array_equal(cut == cut[0, 0, 0], parts == 1)
    assert np.array_equal(after(join, "same", labels, found), labels)
    assert len(np.unique(after(border, "same", labels, found))) == 2
    assert np.array_equal(after(border, "different", labels, found), labels)
    assert (after(border, "nothing", labels, found) == 0).sum() == 1000
    assert (after(join, "nothing", labels, found) == 0).sum() == 1000
    assert np.array_equal(after(join, "skip", labels, found), labels)


def test_what_was_answered_is_not_asked_again_whatever_becomes_of_the_labels() -> None:
    found, (_, labels) = evidence(), bars()
    for said in ("same", "different", "nothing", "skip"):
        left, answers, now = doubts(found, labels), [], labels
        for _ in range(20):
            if not left:
                break
            answers.append(left[0].answered(said))
            now = after(left[0], said, now, found) if len(np.unique(now)) > 2 else now
            left = doubts(found, now, answers)
        assert not left, said
        assert len({(a.kind, a.pieces) for a in answers}) == len(answers)


def test_labels_that_somebody_else_changed_are_reviewed_as_they_are() -> None:
    found, (parts, labels) = evidence(), bars()
    # A person has cut 1 from 2 and merged 3 with 4, without being asked.
    mine = np.array([0, 1, 5, 2, 2], np.int32)[parts]
    kinds = {(d.kind, tuple(sorted(d.objects))) for d in doubts(found, mine)}
    assert ("join", (1, 1)) not in kinds
    assert ("border", (2, 3)) not in kinds
    assert ("border", (1, 5)) in kinds
    assert doubts(found, np.zeros_like(labels)) == []


def many_bars() -> tuple[Evidence, np.ndarray]:
    """Return twelve bars in a row, each an object, that may be one with their neighbours."""
    pieces = np.tile(np.repeat(np.arange(1, 13, dtype=np.int32), 3), (4, 4, 1))
    sums = np.zeros((13, 5))
    sums[1:] = 48.0, 48.0, 48.0, 48.0, 40.0
    pairs = np.column_stack([np.arange(1, 12), np.arange(2, 13)])
    contact = np.tile([16.0, 1.0, 0.0], (11, 1))
    chance = np.linspace(0.3, 0.7, 11)
    return Evidence.of(pieces, sums, pairs, contact, chance, np.zeros(11, np.bool_)), pieces


def totals(said: Said) -> list[int]:
    """Return how many questions there are all told, before each answer to those bars."""
    (found, labels), answers, told = many_bars(), [], []
    while left := doubts(found, labels, answers):
        told.append(len(answers) + len(left))
        answers.append(left[0].answered(said))
    return told


def test_skipping_a_question_brings_up_no_other() -> None:
    told = totals("skip")
    assert told == [len(told)] * len(told)
    assert 1 < len(told) < 11


def test_answers_that_confirm_the_labels_leave_fewer_questions() -> None:
    told = totals("different")
    assert told == sorted(told, reverse=True)
    assert len(told) < len(totals("skip"))


def test_what_is_hardly_matter_is_asked_about_as_an_object() -> None:
    _, labels = bars()
    faint = [d for d in doubts(evidence(matter=5), labels) if d.kind == "object"]
    firm = [d for d in doubts(evidence(matter=255), labels) if d.kind == "object"]
    assert len(faint) == 3
    assert max((d.doubt for d in firm), default=0) < faint[0].doubt


def test_what_is_called_no_object_makes_others_like_it_more_doubtful() -> None:
    found, labels = many_bars()
    found = replace(found, sums=found.sums * [1, 1, 1, 0.4, 1])
    first, *others = (d for d in doubts(found, labels, share=2.0) if d.kind == "object")
    left = np.where(labels == first.objects[0], 0, labels)
    now = [d for d in doubts(found, left, [first.answered("nothing")]) if d.kind == "object"]
    assert max(d.chance for d in now) < min(d.chance for d in others)


def test_an_answer_moves_what_is_like_it_and_hardly_what_is_not() -> None:
    rows = np.zeros((3, len(FEATURES)))
    rows[:, 0], rows[:, FEATURES.index("gap")] = 1, (1.0, 0.9, -1.0)
    chances = np.full(3, 0.7)
    before = Rescoring.of(rows[:0], np.zeros(0, bool), chances[:0]).chances(rows, chances)
    once = Rescoring.of(rows[:1], np.array([False]), chances[:1]).chances(rows, chances)
    moved = before - once
    assert moved[1] > 0.05
    assert moved[1] > 2 * abs(moved[2])


def test_answers_that_contradict_each_other_leave_the_model_finite() -> None:
    rows, same = np.ones((40, len(FEATURES))), np.arange(40) % 2 == 0
    model = Rescoring.of(rows, same, np.full(40, 0.5))
    assert np.isfinite(model.weights).all()
    assert model.chances(rows[:1], np.array([1.0]))[0] <= 1


def test_the_order_is_by_what_a_wrong_decision_costs() -> None:
    found, (_, labels) = evidence(), bars()
    worths = [d.worth for d in doubts(found, labels)]
    assert worths == sorted(worths, reverse=True)
    assert worths[0] > 0


def test_an_answer_remembers_what_was_measured() -> None:
    found, (_, labels) = evidence(), bars()
    join = asked("join", doubts(found, labels, share=2.0))
    answer = join.answered("different")
    assert isinstance(answer, Answer)
    assert answer.chance == pytest.approx(0.4)
    assert len(answer.row) == len(FEATURES)
    assert answer.row[0] == 1


def three_pieces() -> tuple[Evidence, np.ndarray]:
    """Return three pieces of one object; the third was joined to the second."""
    pieces = np.zeros((4, 4, 9), np.int32)
    for k in (1, 2, 3):
        pieces[:, :, 3 * k - 3 : 3 * k] = k
    sums = np.zeros((4, 5))
    sums[1:] = 48.0, 48.0, 48.0, 48.0, 40.0
    pairs = np.array([[1, 2], [1, 3], [2, 3]])
    # It holds to the first over four times as many faces.
    contact = np.column_stack([[10.0, 40.0, 10.0], np.ones(3), np.zeros(3)])
    tree = np.array([True, False, True])
    found = Evidence.of(pieces, sums, pairs, contact, np.array([0.5, 0.9, 0.9]), tree)
    return found, np.ones(pieces.shape, np.int32)


def test_what_is_torn_apart_takes_with_it_only_what_holds_to_it_most() -> None:
    found, labels = three_pieces()
    left = {d.pieces: d for d in doubts(found, labels, least=0.0, share=2.0) if d.kind == "join"}
    assert set(left) == {(1, 2), (2, 3)}
    assert left[1, 2].side.tolist() == [2]
    cut = after(left[1, 2], "different", labels, found)
    assert np.array_equal(cut == cut[0, 0, 3], found.pieces == 2)


def test_what_a_person_called_one_object_is_not_torn_apart_by_another_question() -> None:
    found, labels = three_pieces()
    # The third goes with the second now, however little holds it there.
    said = Answer("join", (2, 3), "same", 0.9, (0.0,) * len(FEATURES))
    left = doubts(found, labels, [said], least=0.0, share=2.0)
    joins = {d.pieces: d for d in left if d.kind == "join"}
    assert set(joins) == {(1, 2)}
    assert sorted(joins[1, 2].side.tolist()) in ([1], [2, 3])
    # Both ways lead over a person's word: there is nothing to ask.
    also = Answer("join", (1, 3), "same", 0.9, (0.0,) * len(FEATURES))
    left = doubts(found, labels, [said, also], least=0.0, share=2.0)
    assert not [d for d in left if d.kind == "join"]
