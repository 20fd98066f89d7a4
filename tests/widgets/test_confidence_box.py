"""Marking objects good, training on them, loading and going back to the default."""

from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from napari_unpack.io import open_session, save_session
from napari_unpack.segmentation import Oracle, Region
from napari_unpack.segmentation.common.density_regions import air_offset
from napari_unpack.segmentation.confidence.features import FEATURES, features
from napari_unpack.segmentation.confidence.oracle import fit_features
from napari_unpack.segmentation.confidence.reasons import reasons
from napari_unpack.segmentation.object_table import confidences
from napari_unpack.session import Session
from napari_unpack.session.object_facts import reasons_of
from napari_unpack.widgets.confidence_reasons import ConfidenceReasons
from napari_unpack.widgets.object_columns import Column
from opened_panel import add_bag, controller_with, open_panel, pile_of_balls, press


@pytest.fixture
def taught(make_napari_viewer_proxy, qtbot, monkeypatch):
    """Return a panel with the pile on its stage, and its session."""
    viewer = make_napari_viewer_proxy()
    _, labels = add_bag(viewer)
    panel = open_panel(viewer, qtbot)
    session = controller_with(panel, qtbot, labels)
    return panel, session


def some_model():
    """Return a model that has learned from nothing in particular."""
    return fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES))))


@pytest.fixture
def own_model(tmp_path):
    """Return the file of a model of one's own."""
    path = tmp_path / "mine.npz"
    some_model().save(path)
    return path


def endless(labels, volume, spacing, oracle, share, ids=None):
    """Score for ever, as far as the bar tells; it can be cancelled."""
    while True:
        share(0.5)


def _select(panel, ids):
    panel.commands.select(ids)
    panel.objects.table.show_selection(frozenset(ids))
    panel.objects.confidence.refresh()


def _texts(panel, column):
    model = panel.objects.model
    return {model.id_at(r): model.data(model.index(r, column)) for r in range(model.rowCount())}


def test_marks_show_in_the_table_can_be_undone_and_too_few_are_refused(
    taught, qtbot, monkeypatch, tmp_path
):
    panel, session = taught
    box = panel.objects.confidence
    assert not box.mark.isEnabled()
    _select(panel, [1, 2])
    press(qtbot, box.mark)
    assert session.examples == {1, 2}
    qtbot.waitUntil(lambda: _texts(panel, Column.NAME)[1].endswith("✓"), timeout=20000)
    assert not _texts(panel, Column.NAME)[3].endswith("✓")
    session.undo()
    assert session.examples == frozenset()
    qtbot.waitUntil(lambda: not _texts(panel, Column.NAME)[1].endswith("✓"), timeout=20000)

    # Too few are refused in a sentence.
    warned = []
    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", warned.append)
    session.mark_examples([1, 2, 3])
    box.refresh()
    # Before a file is asked for.
    assert "training needs 8" in box.sentence.text()
    assert not box.train.isEnabled()
    box.train_to(str(tmp_path / "mine.npz"))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert len(warned) == 1
    assert "at least 8" in warned[0]
    assert not (tmp_path / "mine.npz").exists()


def test_a_trained_confidence_judges_and_the_default_comes_back(
    taught, qtbot, tmp_path, monkeypatch
):
    panel, session = taught
    box = panel.objects.confidence
    path = tmp_path / "mine.npz"
    rng = np.random.default_rng(0)
    fit_features(rng.normal(size=(40, len(FEATURES)))).save(path)
    box.use_oracle(str(path))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    mine = session.objects["confidence"].to_numpy().copy()
    assert np.isfinite(mine).all()
    assert "Using your own model" in box.sentence.text()
    press(qtbot, box.restore)
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert (session.objects["confidence"].to_numpy() != mine).any()
    assert "Using the built-in model" in box.sentence.text()
    path.write_text("no oracle")
    warned = []
    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", warned.append)
    box.use_oracle(str(path))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert "not an oracle" in warned[0]
    # One that knows none of the objects says so.
    session.use_oracle(None, dict.fromkeys(session.ids, 1e-9))
    box.refresh()
    assert "trained on other kinds" in box.sentence.text()
    session.use_oracle(None, {i: 0.1 * i for i in session.ids})
    box.refresh()
    assert "trained on other kinds" not in box.sentence.text()


def test_scoring_shows_its_progress_and_can_be_cancelled(taught, qtbot, own_model, monkeypatch):
    panel, session = taught
    box, path = panel.objects.confidence, own_model

    monkeypatch.setattr("napari_unpack.segmentation.object_table.confidences", endless)
    before = session.objects["confidence"].to_numpy().copy()
    box.use_oracle(str(path))
    qtbot.waitUntil(lambda: box.progress.text.text() == "Scoring", timeout=20000)
    assert not box.progress.isHidden()
    assert not box.load.isEnabled()
    press(qtbot, box.progress.cancel)
    qtbot.waitUntil(lambda: not box.running, timeout=1000)
    np.testing.assert_array_equal(session.objects["confidence"].to_numpy(), before)
    assert "Using the built-in model" in box.sentence.text()
    assert box.load.isEnabled()


def test_a_bag_opened_while_the_one_before_is_scored_is_scored_as_well(
    taught, qtbot, own_model
) -> None:
    panel, _ = taught
    box, path = panel.objects.confidence, own_model
    box.use_oracle(str(path))
    panel.workspace.open(other := Session(*pile_of_balls()))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert other.label_editor.oracle is not None


def test_scoring_that_fails_is_told_once_and_not_begun_again(
    taught, qtbot, own_model, monkeypatch
) -> None:
    panel, _ = taught
    box, path = panel.objects.confidence, own_model
    box.use_oracle(str(path))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    told, calls = [], []

    def broken(*_, **__):
        calls.append(None)
        raise MemoryError("no memory")

    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", told.append)
    monkeypatch.setattr("napari_unpack.segmentation.object_table.confidences", broken)
    panel.workspace.open(other := Session(*pile_of_balls()))
    qtbot.waitUntil(lambda: panel.workspace.settled and not box.running, timeout=60000)
    qtbot.wait(500)
    assert len(calls) == 1
    assert told == ["No memory."]
    assert "Using the built-in model" in box.sentence.text()
    assert other.label_editor.oracle is None


def test_a_file_that_is_no_model_begins_nothing_that_was_called_off(
    taught, qtbot, own_model, tmp_path, monkeypatch
) -> None:
    panel, _ = taught
    box, path = panel.objects.confidence, own_model
    box.use_oracle(str(path))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)

    with monkeypatch.context() as patched:
        patched.setattr("napari_unpack.segmentation.object_table.confidences", endless)
        panel.workspace.open(other := Session(*pile_of_balls()))
        press(qtbot, box.progress.cancel)
        qtbot.waitUntil(lambda: not box.running, timeout=5000)
    (tmp_path / "other.npz").write_text("no model")
    warned = []
    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", warned.append)
    box.use_oracle(str(tmp_path / "other.npz"))
    qtbot.waitUntil(lambda: len(warned) == 1 and not box.running, timeout=60000)
    assert other.label_editor.oracle is None


def test_what_a_saved_bag_lacks_is_scored_with_a_bar_and_a_failure_is_told_once(
    taught, qtbot, tmp_path, monkeypatch
) -> None:
    panel, _ = taught
    box, path = panel.objects.confidence, tmp_path / "a.unpack"
    bare = Session(*pile_of_balls())
    bare.use_oracle(None, {})
    save_session(bare, path)
    waits = Event()
    told = []

    def failing(labels, volume, spacing, oracle, share, ids=None):
        while not waits.wait(0.01):
            share(0.5)
        raise MemoryError("no memory")

    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", told.append)
    with monkeypatch.context() as patched:
        patched.setattr("napari_unpack.segmentation.object_table.confidences", failing)
        panel.workspace.open(opened := open_session(path))
        qtbot.waitUntil(lambda: box.progress.text.text() == "Scoring", timeout=20000)
        assert box.sentence.text() == "Working…"
        assert not box.progress.isHidden()
        waits.set()
        qtbot.waitUntil(lambda: not box.running, timeout=20000)
        # A few: nobody waits for them, but a failure is told as well.
        opened.use_oracle(None, dict.fromkeys(opened.ids[1:], 0.5))
        panel.workspace.open(opened)
        qtbot.waitUntil(lambda: len(told) == 2, timeout=20000)
        qtbot.wait(500)
    assert told == ["No memory."] * 2
    opened.use_oracle(None, {})
    panel.workspace.open(opened)
    qtbot.waitUntil(lambda: opened.objects["confidence"].notna().all(), timeout=60000)
    # What was missing chose no model for other sessions.
    assert "Using the built-in model" in box.sentence.text()


def test_an_earlier_file_stays_where_training_is_called_off_while_it_scores(
    taught, qtbot, tmp_path, monkeypatch
):
    panel, session = taught
    box, path = panel.objects.confidence, tmp_path / "mine.npz"
    path.write_text("of before")
    fitted = some_model()
    monkeypatch.setattr(
        "napari_unpack.segmentation.training.train_on_examples", lambda *_, **__: fitted
    )

    with monkeypatch.context() as patched:
        patched.setattr("napari_unpack.segmentation.object_table.confidences", endless)
        box.train_to(str(path))
        qtbot.waitUntil(lambda: box.progress.text.text() == "Scoring", timeout=20000)
        press(qtbot, box.progress.cancel)
        qtbot.waitUntil(lambda: not box.running, timeout=5000)
    assert path.read_text() == "of before"
    assert session.label_editor.oracle is None
    box.train_to(str(path))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    np.testing.assert_array_equal(Oracle.load(path).axes, fitted.axes)
    assert session.label_editor.oracle is fitted


def test_undo_and_repairs_leave_no_number_of_another_model(taught, qtbot, own_model) -> None:
    panel, session = taught
    box, path = panel.objects.confidence, own_model
    session.merge([1, 2])
    box.use_oracle(str(path))
    # While it is loaded.
    session.merge([3, 4])
    qtbot.waitUntil(lambda: not box.running, timeout=60000)

    def all_by_it():
        found = session.objects["confidence"]
        oracle = session.label_editor.oracle
        wanted = confidences(session.labels, session.volume, tuple(session.spacing), oracle)
        return found.to_numpy() == pytest.approx(np.array([wanted[i] for i in found.index]))

    qtbot.waitUntil(all_by_it, timeout=60000)
    assert isinstance(session.label_editor.oracle, Oracle)
    while session.undo():
        qtbot.waitUntil(all_by_it, timeout=60000)
    qtbot.waitUntil(lambda: "–" not in _texts(panel, Column.CONFIDENCE).values(), timeout=20000)


def test_a_session_saved_with_a_model_goes_on_with_it(taught, qtbot, own_model, tmp_path) -> None:
    panel, _ = taught
    box, model, path = panel.objects.confidence, own_model, tmp_path / "a.unpack"
    other = Session(*pile_of_balls())
    oracle = Oracle.load(model)
    other.use_oracle(oracle, dict.fromkeys(other.ids, 0.375))
    save_session(other, path)
    panel.workspace.open(other := open_session(path))
    qtbot.waitUntil(lambda: panel.workspace.settled and not box.running, timeout=60000)
    assert set(other.objects["confidence"]) == {0.375}
    assert "Using your own model" in box.sentence.text()
    assert reasons_of(other, 1) == reasons(oracle, _features(other, 1))
    # It is that session's alone.
    panel.workspace.open(Session(*pile_of_balls()))
    assert "Using the built-in model" in box.sentence.text()
    assert not box.restore.isEnabled()
    panel.workspace.open(other)
    press(qtbot, box.restore)
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert "Using the built-in model" in box.sentence.text()
    assert 0.375 not in set(other.objects["confidence"])


def _features(session, object_id):
    box = session.boxes.slices(object_id)
    air = air_offset(session.volume, session.labels)
    mask, spacing = session.labels[box] == object_id, tuple(session.spacing)
    return features(Region.of(mask, session.volume, box, spacing, air))


def test_examples_too_small_to_learn_from_are_not_counted(taught, qtbot) -> None:
    panel, _ = taught
    box = panel.objects.confidence
    labels = np.zeros((12, 12, 60), np.uint16)
    for k in range(12):
        labels[2:5, 2:5, 5 * k + 1 : 5 * k + 4] = k + 1
    session = Session(np.where(labels > 0, 1000, 20).astype(np.uint16), labels)
    panel.workspace.open(session)
    session.mark_examples(session.ids)
    box.refresh()
    assert "12 examples, 12 of them below 64 voxels" in box.sentence.text()
    assert "training needs 8 of 64 voxels or more" in box.sentence.text()
    assert not box.train.isEnabled()


def test_reasons_of_the_model_before_are_none_of_the_model_in_use():
    asked, editor = [], SimpleNamespace(oracle=None)
    session = SimpleNamespace(
        bag=object(), label_editor=editor, label_data=SimpleNamespace(revision=1)
    )
    workspace = SimpleNamespace(
        session=session,
        switched=SimpleNamespace(connect=lambda _: None),
        scheduler=SimpleNamespace(submit=lambda task, worker, done, failed: asked.append(done)),
    )
    why = ConfidenceReasons(workspace)
    why.of(1)
    editor.oracle = object()
    why.of(1)
    asked[0](("it is thin",))
    assert "being worked out" in why.of(1)
    asked[1](("it is flat",))
    assert why.of(1) == "Lowered because it is flat."
