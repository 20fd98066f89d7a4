import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from napari_unpack.rendering.gl import offscreen, trial

ROOT = Path(__file__).parents[3]


def test_software_rasterisers_are_recognised():
    assert offscreen.is_software_renderer("llvmpipe (LLVM 15.0.6, 256 bits)")
    assert not offscreen.is_software_renderer("NVIDIA GeForce RTX 4090/PCIe/SSE2")


def test_the_canvas_that_was_current_is_current_again(offscreen_context):
    from vispy import app
    from vispy.gloo.context import get_current_canvas

    other = app.Canvas(app=app.Application("egl"), size=(2, 2))
    other.set_current()
    with offscreen_context.use():
        assert get_current_canvas() is offscreen_context.canvas
    assert get_current_canvas() is other
    other.close()


def test_another_thread_is_told_why_it_cannot_draw(offscreen_context):
    said = []

    def ask():
        said.append(offscreen.unavailable_because())
        try:
            with offscreen_context.use():
                said.append("drew")
        except RuntimeError as error:
            said.append(str(error))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    assert "another thread" in said[0]
    assert "belongs to the thread" in said[1]


def in_a_process_with(code, **environment):
    env = {k: v for k, v in os.environ.items() if k not in ("PYOPENGL_PLATFORM", "DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is Linux's")
def test_a_process_with_a_display_keeps_pyopengl_for_its_windows():
    code = (
        "import os; from napari_unpack.rendering.gl import offscreen;"
        "print(offscreen.unavailable_because(), os.environ.get('PYOPENGL_PLATFORM'))"
    )
    assert in_a_process_with(code, DISPLAY=":77").startswith("a display is present")
    assert in_a_process_with(code, DISPLAY=":77").endswith("None")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is Linux's")
def test_without_a_display_it_needs_no_setting_at_all(offscreen_context):
    code = (
        "from napari_unpack.rendering.gl import offscreen; print(offscreen.unavailable_because())"
    )
    assert in_a_process_with(code) == "None"


BAG = """
import os, sys, threading, warnings
import numpy as np
import napari_unpack as nu
from napari_unpack.rendering.gl import offscreen
offscreen.is_software = lambda: False
labels = np.zeros((12, 12, 12), np.uint16)
labels[2:6] = 1
labels[7:10] = 2
def cast(backend="auto"):
    return float(nu.render(labels * np.uint16(700), labels, size=(32, 32), backend=backend).sum())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_a_forked_process_draws_with_the_processor(offscreen_context):
    code = (
        BAG
        + """
here = cast("gl")
child = os.fork()
if child == 0:
    try:
        assert "another" in offscreen.unavailable_because()
        assert abs(cast() - here) < 1
    except BaseException as error:
        print(repr(error), flush=True)
        os._exit(1)
    os._exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    )
    assert in_a_process_with(code) == "0"


def test_threads_that_ask_first_at_once_make_one_context_and_all_draw(offscreen_context):
    code = (
        BAG
        + """
cast("cpu")
sys.setswitchinterval(1e-5)
warnings.simplefilter("error")
together, found = threading.Barrier(6), []
def ask():
    together.wait()
    found.append(cast())
threads = [threading.Thread(target=ask) for _ in range(6)]
[t.start() for t in threads]
[t.join() for t in threads]
print(len(found), max(found) - min(found) < 1, offscreen.context().serves)
"""
    )
    assert in_a_process_with(code) == "6 True True"


def test_other_shaders_have_a_driver_tried_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked = []
    monkeypatch.setattr(trial, "tried", lambda _: asked.append(1) or "")
    for digest in ("a", "b", "a"):
        monkeypatch.setattr(trial, "shaders_digest", lambda digest=digest: digest)
        assert trial.refusal("card") == ""
    assert len(asked) == 2


def test_the_digest_is_of_every_shader(monkeypatch, tmp_path):
    whole = trial.shaders_digest()
    assert whole == trial.shaders_digest()
    copied = tmp_path / "shaders"
    shutil.copytree(ROOT / "shaders", copied)
    monkeypatch.setattr(trial.resources, "files", lambda _: copied)
    assert trial.shaders_digest() == whole
    for name in ("lib/light.glsl", "passes/quad.frag"):
        (copied / name).write_text((copied / name).read_text("utf-8") + "\n", "utf-8")
        assert trial.shaders_digest() != whole
        whole = trial.shaders_digest()


def test_a_failed_context_raises_with_its_reason(monkeypatch):
    monkeypatch.setattr(offscreen, "probe", lambda: (None, "no driver"))
    assert not offscreen.available()
    with pytest.raises(RuntimeError, match="no offscreen GL: no driver"):
        offscreen.context()
