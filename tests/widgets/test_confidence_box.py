"""Marking objects good, training on them, loading and going back to the default."""

import numpy as np
import pytest

from napari_unpack.segmentation.confidence.features import FEATURES
from napari_unpack.segmentation.confidence.oracle import fit_features
from napari_unpack.session import Session
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


def test_scoring_shows_its_progress_and_can_be_cancelled(taught, qtbot, tmp_path, monkeypatch):
    panel, session = taught
    box, path = panel.objects.confidence, tmp_path / "mine.npz"
    fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES)))).save(path)

    def endless(labels, volume, spacing, oracle, share):
        while True:
            share(0.5)

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
    taught, qtbot, tmp_path
) -> None:
    panel, _ = taught
    box, path = panel.objects.confidence, tmp_path / "mine.npz"
    fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES)))).save(path)
    box.use_oracle(str(path))
    panel.workspace.open(other := Session(*pile_of_balls()))
    qtbot.waitUntil(lambda: not box.running, timeout=60000)
    assert other.label_editor.oracle is not None
