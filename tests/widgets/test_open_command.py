"""`napari-unpack open` goes on, in a real viewer, with what `batch` is done with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import napari
import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from typer.testing import CliRunner

from napari_unpack.batches.inputs import find_inputs
from napari_unpack.batches.run_settings import Settings, claim_folder
from napari_unpack.batches.scan_work import Place, work_on
from napari_unpack.cli import app
from napari_unpack.viewer import screen
from opened_panel import pile_of_balls


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def test_a_scan_of_a_run_opens_packed_with_its_whole_way_out(
    viewer: Any, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume, labels = pile_of_balls()
    output, settings = tmp_path / "results", Settings(pictures=False)
    for name in ("one", "two"):
        np.savez(tmp_path / f"{name}.npz", volume=volume, labels=labels, spacing=np.ones(3))
    claim_folder(output, settings)
    for scan in find_inputs([tmp_path / "*.npz"]):
        assert work_on(scan, Place(output, settings), {}).status == "done"
    monkeypatch.setattr(screen, "check_screen", lambda: None)
    monkeypatch.setattr(napari, "Viewer", lambda title: viewer)
    monkeypatch.setattr(napari, "run", lambda: None)
    assert "say which with --scan (one, two)" in run("open", output).stderr
    assert "none is called 'six'" in run("open", output, "--scan", "six").stderr
    assert "neither a session nor a folder" in run("open", tmp_path).stderr
    assert "no such session or folder" in run("open", tmp_path / "nothing").stderr
    told = run("open", output, "--scan", "two")
    assert told.exit_code == 0, told.output
    (panel,) = viewer.window.dock_widgets.values()
    qtbot.waitUntil(lambda: panel.workspace.session is not None, timeout=30000)
    session = panel.workspace.session
    assert session.step == 0
    assert {i for group in session.steps for i in group} == set(session.ids)
    # The bar runs the whole unpacking at once.
    assert panel.unpack.step_slider.slider.maximum() == len(session.steps)
