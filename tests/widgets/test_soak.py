"""Six hundred commands of the soak: `make soak` goes on for an hour."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from napari_unpack.session import Session
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import pile_of_balls

COMMANDS = 600


def soak_tool() -> Any:
    path = Path(__file__).parents[2] / "tools" / "soak.py"
    spec = importlib.util.spec_from_file_location("soak_tool", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["soak_tool"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.timeout(900)
def test_random_commands_at_speed_neither_err_nor_leak(viewer: Any, panel: UnpackingWidget) -> None:
    panel.workspace.open(Session(*pile_of_balls(), spacing=(2.0, 1.0, 1.0)))
    panel.workspace.controller.seconds = 0.1
    assert panel.workspace.controller.settle(90)
    tool = soak_tool()
    report = tool.soak(viewer, panel, 0.0, samples=9, fewest=COMMANDS)
    assert report.errors == [], report
    assert report.commands.total() >= COMMANDS, report
    # The later half of so few: before, what is filled once still counts. In so much shorter a time
    # so much less may come.
    report.warm_up = 1 / 2
    most = tool.FLAT * (1 - report.warm_up) / (1 - tool.WARM_UP)
    if report.growth >= most:
        # After other tests in this process some of that may be filled later. A leak goes on.
        report = tool.soak(viewer, panel, 0.0, seed=1, samples=5, fewest=COMMANDS // 2)
        report.warm_up = 0
    assert report.errors == [], report
    assert report.growth < most, report
