"""Unsaved work is kept by itself, and offered after a crash."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

import napari_unpack as nu
from napari_unpack.io import recovery as copies
from napari_unpack.io.headless import snapshot
from napari_unpack.io.recovery import UnsavedCopy, leftovers, recovery_folder
from napari_unpack.segmentation.confidence.features import FEATURES
from napari_unpack.segmentation.confidence.oracle import fit_features
from napari_unpack.widgets import recovery
from napari_unpack.widgets.preferences import Preferences
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import (
    open_panel,
    pile_of_balls,
    press,
    rest,
    states,
)

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def worked(panel: UnpackingWidget, piled: Any) -> UnpackingWidget:
    """Return the panel with a session in which nothing was done yet."""
    panel.workspace.controller.seconds = 0.15
    return panel


def on_disk() -> dict[str, Any] | None:
    """Return what is kept of the only session, None where that is nothing."""
    found = list(recovery_folder().glob("*/*/session.json"))
    return json.loads(found[0].read_bytes()) if found else None


def out_on_disk() -> int:
    kept = on_disk()
    return 0 if kept is None else len(kept["session"]["situation"]["out"])


def another_napari(does: str, errors: int | None = None) -> subprocess.Popen[str]:
    """Start a process that does what a function of `killed_napari` does."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(__file__).parents[1]),
        # To compile what colours labels would take each of them seconds.
        "NAPARI_COLORMAP_BACKEND": "pure_python",
    }
    call = does if "(" in does else f"{does}()"
    # A crash that comes once in a hundred runs says where it was.
    command = [
        sys.executable,
        "-X",
        "faulthandler",
        "-c",
        f"import killed_napari; killed_napari.{call}",
    ]
    pipes = {"stdout": subprocess.PIPE, "stderr": errors}
    return subprocess.Popen(command, env=environment, text=True, **pipes)


def crash() -> dict[str, Any]:
    """Unpack in another napari, kill it while things fly, and return what was done there."""
    other = another_napari("unpack_for_ever")
    try:
        assert other.stdout is not None
        return json.loads(other.stdout.readline())
    finally:
        other.kill()
        other.wait()


def test_a_model_that_scores_what_was_worked_on_is_on_disk_too(
    worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel, path = worked, tmp_path / "mine.npz"
    fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES)))).save(path)
    panel.workspace.session.mark_examples([1])
    qtbot.waitUntil(lambda: on_disk() is not None, timeout=10000)
    assert "model" not in on_disk()
    panel.objects.confidence.use_oracle(str(path))
    qtbot.waitUntil(lambda: "model" in (on_disk() or {}), timeout=60000)
    press(qtbot, panel.objects.confidence.restore)
    built_in = {"format": "built-in"}
    qtbot.waitUntil(lambda: (on_disk() or {}).get("model") == built_in, timeout=60000)


def test_a_change_is_on_disk_within_two_seconds_and_gone_once_it_is_saved(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = worked
    rest(panel, qtbot)
    qtbot.wait(1200)
    assert on_disk() is None
    # The first change waits for the arrays; of a small bag they are nothing.
    for count in (1, 2):
        begun = monotonic()
        press(qtbot, panel.unpack.next)
        qtbot.waitUntil(lambda count=count: out_on_disk() == count, timeout=10000)
        assert monotonic() - begun < 2 * 3
    assert leftovers(recovery_folder()) == []
    # Another panel in this process neither offers nor touches it.
    panel.files.save_to(tmp_path / "kept.unpack")
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=60000)
    qtbot.waitUntil(lambda: on_disk() is None, timeout=10000)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: out_on_disk() == 3, timeout=10000)
    rest(panel, qtbot)
    panel.commands.undo()
    panel.commands.undo()
    panel.commands.undo()
    qtbot.waitUntil(lambda: out_on_disk() == 0, timeout=10000)
    # Discarded: the session is gone, and its copy.
    viewer.layers.remove("Packed")
    qtbot.waitUntil(lambda: panel.unsaved.question is not None, timeout=10000)
    box = panel.unsaved.question
    qtbot.mouseClick(box.button(box.StandardButton.Discard), LEFT)
    assert panel.workspace.session is None
    panel.end()
    assert list(recovery_folder().iterdir()) == []


def test_a_full_disk_is_told_once_and_stops_nothing(
    worked: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = worked
    monkeypatch.setattr(copies, "SPARE_BYTES", 1 << 62)
    before = len(notification_manager.records)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: len(notification_manager.records) > before, timeout=10000)
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    qtbot.wait(1500)
    (said,) = [one.message for one in notification_manager.records[before:]]
    assert "The disk is nearly full." in said
    assert panel.workspace.session.step == 2


def test_nothing_of_the_scan_stays_on_disk_once_keeping_is_switched_off(
    worked: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, stored = worked, Preferences()
    monkeypatch.setattr(recovery, "preferences", lambda: stored)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: out_on_disk() == 1, timeout=10000)
    stored = Preferences(keep_unsaved=False)
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: not list(recovery_folder().glob("*/*/*")), timeout=10000)
    stored = Preferences()
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: out_on_disk() == 3, timeout=10000)


def test_what_was_continued_and_saved_is_not_offered_again_where_nothing_is_kept(
    viewer: Any, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, left = nu.Session(*pile_of_balls()), UnsavedCopy(recovery_folder())
    left.keep(snapshot(session), "bag", None, lambda fraction: None, ())
    left.close()
    monkeypatch.setattr(recovery, "preferences", lambda: Preferences(keep_unsaved=False))
    panel = open_panel(viewer, qtbot)
    qtbot.waitUntil(panel.recovery.isVisible, timeout=20000)
    press(qtbot, panel.recovery.restore)
    qtbot.waitUntil(lambda: panel.workspace.session is not None, timeout=60000)
    rest(panel, qtbot)
    # A second crash must not find nothing.
    assert len(leftovers(recovery_folder())) == 1
    panel.files.save_to(tmp_path / "saved.unpack")
    qtbot.waitUntil(lambda: leftovers(recovery_folder()) == [], timeout=60000)
    panel.end()


def test_what_was_discarded_for_nothing_is_kept_again(
    worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = worked
    panel.unsaved.found_in(61)
    for count in (0, 1):
        if count:
            press(qtbot, panel.unpack.next)
        panel.keeper.follow()
        qtbot.waitUntil(lambda count=count: out_on_disk() == count, timeout=10000)
        qtbot.waitUntil(lambda: on_disk() is not None, timeout=10000)
        # It is work when the window closes: where nothing was done no question comes before it.
        panel.unsaved.give_up()
        qtbot.waitUntil(lambda: on_disk() is None, timeout=10000)
        panel.files.open_from(tmp_path / "missing.unpack")
        qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=60000)
        assert panel.unsaved.worth_keeping
        qtbot.waitUntil(lambda: on_disk() is not None, timeout=10000)
        assert out_on_disk() == count


@pytest.mark.parametrize("discarded", [True, False])
def test_a_closed_viewer_leaves_only_what_nobody_was_asked_about(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, discarded: bool
) -> None:
    panel, scheduler = worked, worked.workspace.scheduler
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: out_on_disk() == 1, timeout=10000)
    if discarded:
        panel.unsaved.give_up()
    # As where another window quits napari: this one is closed without a word.
    viewer.close()
    qtbot.waitUntil(lambda: scheduler.closed, timeout=10000)
    assert len(leftovers(recovery_folder())) == (0 if discarded else 1)


@pytest.mark.timeout(300)
def test_after_a_kill_everything_is_there_again(viewer: Any, qtbot: QtBot) -> None:
    done = crash()
    assert list(done["states"].values()).count("UNPACKED") == 3
    panel = open_panel(viewer, qtbot)
    bar = panel.recovery
    qtbot.waitUntil(bar.isVisible, timeout=20000)
    assert bar.sentence.text().startswith("An unpacking of bag from ")
    assert bar.sentence.text().endswith(" was not saved.")
    qtbot.mouseClick(bar.restore, LEFT)
    qtbot.waitUntil(lambda: panel.workspace.session is not None, timeout=60000)
    session = panel.workspace.session
    assert {str(i): name for i, name in states(session).items()} == done["states"]
    assert {str(i): hue for i, hue in session.hues.items()} == done["hues"]
    assert list(session.objects["name"]) == done["names"]
    assert np.bincount(session.labels.ravel()).tolist() == done["voxels"]
    assert "a knife" in done["names"]
    # It is not saved yet, and on disk again before what was left behind goes.
    assert panel.unsaved.changed
    qtbot.waitUntil(lambda: len(list(recovery_folder().iterdir())) == 1, timeout=20000)
    qtbot.waitUntil(lambda: not bar.isVisible(), timeout=20000)
    assert out_on_disk() == 3
    panel.end()

    # Not asked for, so it is offered again; discarded, it is gone.
    again = open_panel(viewer, qtbot)
    qtbot.waitUntil(again.recovery.isVisible, timeout=20000)
    qtbot.mouseClick(again.recovery.discard, LEFT)
    qtbot.waitUntil(lambda: not again.recovery.isVisible(), timeout=20000)
    assert list(recovery_folder().iterdir()) == []
    again.end()


def test_quitting_during_a_segmentation_ends_the_process(qtbot: QtBot) -> None:
    other = another_napari("quit_while_working")
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "closing\n"
        begun = monotonic()
        assert other.stdout.readline() == "closed\n"
        # Two seconds by themselves; three times as much beside other work.
        assert other.wait(timeout=6) == 0
        assert monotonic() - begun < 6
    finally:
        other.kill()
        other.wait()


@pytest.mark.parametrize("worker_sleeps", [False, True])
def test_a_script_that_never_closes_its_viewer_ends_as_it_says_and_loses_nothing(
    worker_sleeps: bool,
) -> None:
    other = another_napari(f"end_without_closing({worker_sleeps})", subprocess.STDOUT)
    try:
        assert other.stdout is not None
        while (line := other.stdout.readline()) != "ending\n":
            assert line, "it has ended before"
        # Ten minutes' work is called off, and no trace of an exception is left.
        status = other.wait(timeout=60)
        said = other.stdout.read()
        assert (status, said) == (3, ""), said
    finally:
        other.kill()
        other.wait()
    assert len(leftovers(recovery_folder())) == 1
    assert out_on_disk() >= 1


@pytest.mark.parametrize("with_panel", [False, True])
def test_a_script_that_fails_ends_with_its_own_traceback_and_no_other(with_panel: bool) -> None:
    other = another_napari(f"fail_with_the_viewer_open({with_panel})", subprocess.STDOUT)
    try:
        said, _ = other.communicate(timeout=120)
    finally:
        other.kill()
        other.wait()
    assert other.returncode == 1, said
    assert said.count("Traceback") == 1
    assert said.endswith("RuntimeError: of the script\n")
