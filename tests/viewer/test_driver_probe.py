"""Drivers and screens that do not serve: the processor takes over, in one sentence."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from OpenGL import platform

from napari_unpack.rendering.gl import formats, offscreen, trial
from napari_unpack.rendering.gl.trial import tried
from napari_unpack.viewer import driver_probe, screen
from napari_unpack.viewer.controller import SessionController
from napari_unpack.viewer.driver_probe import CHILD, probe_driver
from viewer_fixtures import canvas


@pytest.mark.parametrize(
    ("child", "reason"),
    [
        ("import os; os.kill(os.getpid(), 11)", "it ends the process with signal 11"),
        ("import os; os.abort()", "it ends the process with signal 6"),
        ("raise RuntimeError('no shaders')", "RuntimeError: no shaders"),
        ("pass", "it draws nothing"),
        (CHILD, ""),
    ],
)
def test_a_child_tells_whether_a_driver_draws(child: str, reason: str) -> None:
    assert tried(child) == reason


def test_a_card_without_a_window_is_tried_once_by_a_child_before_it_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(offscreen, "_claimed_by_another", lambda: None)
    monkeypatch.setattr(offscreen, "_has_display", lambda: True)
    signal, late = "it ends the process with signal 11", trial.LATE
    said: dict[str, str] = {"card": signal, "other": "", "busy": late}
    asked: list[str] = []

    def child(_: str) -> str:
        asked.append(card)
        return said[card]

    monkeypatch.setattr(trial, "tried", child)
    for card in ("card", "other", "busy") * 2:
        made = SimpleNamespace(renderer=card, version="1.0")
        monkeypatch.setattr(offscreen, "Offscreen", lambda made=made: made)
        reason = f"{card} cannot draw: {said[card]}"
        assert offscreen.first_context.__wrapped__() == (
            (None, reason) if said[card] else (made, None)
        )
    # One that was late may have been on a busy machine.
    assert asked == ["card", "other", "busy", "busy"]


def test_the_child_draws_without_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("PYOPENGL_PLATFORM", "egl"), ("EGL_PLATFORM", "surfaceless")):
        monkeypatch.setenv(name, value)
    assert tried(trial.OFFSCREEN) == ""


def test_a_driver_without_float_textures_is_found_out_by_the_child(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MESA_EXTENSION_OVERRIDE", "-GL_ARB_texture_float -GL_ARB_texture_rg")
    reason = tried(CHILD)
    if not reason:
        pytest.skip("this driver does not let its extensions be taken away")
    assert reason == "RuntimeError: it has no float textures and textures of one channel"


def test_a_driver_is_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reasons = iter(("it draws nothing", "", trial.LATE, trial.LATE))
    monkeypatch.setattr(driver_probe, "tried", lambda _: next(reasons))
    scheduler: Any = SimpleNamespace(submit=lambda task, _, done: done(task.run(None)))
    told: list[str] = []
    for driver in ("card, 1.0", "card, 1.0", "card, 2.0", "card, 1.0"):
        probe_driver(driver, scheduler, told.append)
    assert told == ["it draws nothing", "it draws nothing", "", "it draws nothing"]
    # One that was late may have been on a busy machine.
    for _ in range(2):
        probe_driver("busy, 1.0", scheduler, told.append)
    assert told[4:] == [trial.LATE, trial.LATE]
    assert next(reasons, None) is None


def test_the_processor_draws_where_the_child_did_not(
    staged: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, controller = staged
    said: list[str] = []
    controller.events.message.connect(said.append)
    monkeypatch.setattr(driver_probe, "tried", lambda _: "it ends the process with signal 11")
    for _ in range(2):
        controller.backend = "gl"
        assert controller.settle(30)
        assert controller.casts_with == "cpu"
        controller.backend = "auto"
    assert said == [
        "The graphics card cannot draw the bag (it ends the process with signal 11); the "
        "processor draws it instead."
    ]


def test_without_float_textures_the_picture_is_the_same(
    staged: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, controller = staged
    wanted, session = canvas(viewer), controller.session
    controller.close()
    monkeypatch.setattr(formats, "lacking", lambda: formats.FLOATS)
    said: list[str] = []
    again = SessionController(viewer, session)
    again.events.message.connect(said.append)
    again.backend = "gl"
    again.open()
    assert again.settle(30)
    assert again.casts_with == "cpu"
    np.testing.assert_allclose(canvas(viewer), wanted, atol=2)
    assert len(said) == 1
    assert re.fullmatch(
        r"The graphics driver \(.*\) has no float textures: the processor draws .*", said[0]
    )
    again.close()


def test_no_screen_is_told_before_qt_ends_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    with pytest.raises(
        OSError, match=r"^napari finds no screen here: run this on a desktop, or with `xvfb-run"
    ):
        screen.check_screen()


def test_variables_of_wayland_do_not_count_on_another_screen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "")
    monkeypatch.delenv("PYOPENGL_PLATFORM")
    screen.check_screen()
    assert screen.os.environ["PYOPENGL_PLATFORM"] == "glx"
    assert screen.screen_notice() == ""
    monkeypatch.setattr(platform, "PLATFORM", type("EGLPlatform", (), {})())
    assert screen.screen_notice().endswith("Start napari as `PYOPENGL_PLATFORM=glx napari`.")
