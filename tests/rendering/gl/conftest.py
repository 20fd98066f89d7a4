"""One headless GL context for all tests here; UNPACK_REQUIRE_GL=1 makes its absence a failure."""

import os

import pytest

# Before anything imports PyOpenGL (napari's own pytest plugin does), as the Makefile does.
if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")


@pytest.fixture(scope="session")
def offscreen_context():
    from napari_unpack.rendering.gl import offscreen

    reason = offscreen.unavailable_because()
    if reason is not None:
        if os.environ.get("UNPACK_REQUIRE_GL") == "1":
            pytest.fail(f"UNPACK_REQUIRE_GL=1, but there is no offscreen GL: {reason}")
        pytest.skip(f"no offscreen GL: {reason}")
    return offscreen.context()


@pytest.fixture
def filter_tolerance(offscreen_context):
    """How far colours of filtered density may be from the ray caster's, by the driver.

    A card's filter has 8 bits of weight (test_glsl_functions), which random voxels show most.
    """
    from napari_unpack.rendering.gl import offscreen

    return (2 if offscreen.is_software() else 8) / 255


@pytest.fixture
def gl(offscreen_context):
    """The current context; no error may be left in its queue."""
    from OpenGL import GL

    with offscreen_context.use() as context:
        yield context
        offscreen_context.canvas.set_current()
        context.flush_commands()
        assert GL.glGetError() == GL.GL_NO_ERROR


@pytest.fixture
def compute(gl):
    """The current context, which has compute shaders."""
    from napari_unpack.rendering.gl import compute_program

    if not compute_program.supported():
        reason = "this driver has no compute shaders (OpenGL 4.3)"
        if os.environ.get("UNPACK_REQUIRE_GL") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    return gl


@pytest.fixture(scope="session")
def shared_canvas(offscreen_context):
    from vispy import app, scene

    canvas = scene.SceneCanvas(app=app.Application("egl"), size=(60, 40), bgcolor="black")
    canvas.central_widget.border_width = 0
    yield canvas
    canvas.close()


@pytest.fixture
def canvas(shared_canvas):
    """A vispy scene canvas of 60 x 40 pixels, current and empty; no error may be left in it."""
    from OpenGL import GL

    shared_canvas.set_current()
    yield shared_canvas
    shared_canvas.set_current()
    shared_canvas.context.flush_commands()
    assert GL.glGetError() == GL.GL_NO_ERROR
    for widget in list(shared_canvas.central_widget.children):
        shared_canvas.central_widget.remove_widget(widget)
        widget.parent = None
