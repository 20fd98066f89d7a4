import subprocess
import sys
import threading

import pytest

from napari_unpack.rendering.gl import offscreen


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
    import os

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


def test_a_failed_context_raises_with_its_reason(monkeypatch):
    monkeypatch.setattr(offscreen, "probe", lambda: (None, "no driver"))
    assert not offscreen.available()
    with pytest.raises(RuntimeError, match="no offscreen GL: no driver"):
        offscreen.context()
