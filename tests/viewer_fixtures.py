"""What the tests of layers, viewer and widgets share: a small bag, its session, a shown viewer."""

from __future__ import annotations

import gc
import importlib
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest

from opened_panel import SMALL, add_bag, controller_with, open_panel

SHAPE = (40, 48, 60)

MOVEMENTS = {
    "viewer.animation": ("FADE_SECONDS", "FRAMING_SECONDS", "GLIDE_SECONDS"),
    "viewer.ghost": ("FADE_SECONDS",),
    "geometry.camera_glide": ("GLIDE_SECONDS",),
}
"""How long what moves by itself is on its way, by module."""


@pytest.fixture(scope="session", autouse=True)
def modules_and_manifests_read_once() -> Iterator[None]:
    """Import what all tests need; keep napari from work that each new viewer would do again.

    The manifests of all that is installed do not change, and nobody reads the settings on disk,
    which take a tenth of a second to write whenever one changes.
    """
    for name in ("napari", "napari._qt.qt_viewer", "napari_unpack.widgets.unpacking_widget"):
        importlib.import_module(name)
    importlib.import_module("napari_unpack.viewer.controller")
    # Else the first panel's worker loads it while a test of stalls watches the window.
    importlib.import_module("napari_unpack.segmentation.pipeline")
    from napari.settings import get_settings
    from npe2 import PluginManifest

    get_settings().config_path = None
    found = list(PluginManifest.discover())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PluginManifest, "discover", lambda *_, **__: iter(found))
        yield


@pytest.fixture(scope="session", autouse=True)
def kernels_compiled() -> None:
    """Compile what casts, which takes a slow machine minutes, before any test waits for it."""
    _cast_once()


@cache
def _cast_once() -> None:
    # Once for all three folders of tests.
    from napari_unpack.rendering.compose import scene_image
    from napari_unpack.session import Session

    for density in (np.uint16, np.float32):
        volume, labels = phantom()
        session = Session(volume.astype(density), labels, spacing=(1.5, 1.5, 1.5))
        session.backend = "cpu"
        session.recolor()
        session.unpack(1)
        session.restore(1)
        session.unpack(1)
        scene_image(session.scene(), session.overview(), (48, 64), backend="cpu")


@pytest.fixture(autouse=True)
def nothing_remembered(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep what the panel remembers from other tests, and from the person's own settings."""
    from qtpy.QtCore import QSettings

    form, scope = QSettings.Format.IniFormat, QSettings.Scope.UserScope
    QSettings.setPath(form, scope, str(tmp_path_factory.mktemp("settings")))


@pytest.fixture(autouse=True)
def nothing_kept_of_other_tests(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Give each test a data folder of its own, in which no unsaved work lies."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))


@pytest.fixture(autouse=True)
def driver_that_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the driver for one that survives shaders: each child would take a second."""
    from napari_unpack.viewer import driver_probe

    monkeypatch.setattr(driver_probe, "tried", lambda _: "")


@pytest.fixture(autouse=True)
def movements_cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what fades and glides arrive in a fifth of its time, which is still a few frames.

    Frames follow each other as fast as they can be drawn, so a movement costs the processor as
    long as it takes. What is seen on the way is tested with clocks that are moved by hand.
    """
    for module, names in MOVEMENTS.items():
        holder = importlib.import_module(f"napari_unpack.{module}")
        for name in names:
            monkeypatch.setattr(holder, name, getattr(holder, name) / 5)


@pytest.fixture(autouse=True)
def earlier_tests_out_of_the_collectors_way() -> None:
    """Keep the garbage collector off all that was there before a test.

    napari collects whenever a layer is removed; going through all modules, and whatever earlier
    tests left in caches, took more time than the tests.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def mouse_buttons_let_go(qapp: Any) -> Iterator[None]:
    """Let go of mouse and keys after each test: the next one asks whether any is held.

    Qt's double click for tests ends with the button held, as does a press alone, and a click with
    Shift leaves Shift held until the next event.
    """
    yield
    from qtpy.QtCore import Qt
    from qtpy.QtTest import QTest
    from qtpy.QtWidgets import QWidget

    button = Qt.MouseButton
    held = [b for b in (button.LeftButton, button.RightButton) if b & qapp.mouseButtons()]
    if qapp.keyboardModifiers() != Qt.KeyboardModifier.NoModifier:
        held = held or [button.LeftButton]
    if held:
        elsewhere = QWidget()
        for one in held:
            QTest.mouseRelease(elsewhere, one)


def phantom() -> tuple[np.ndarray, np.ndarray]:
    """Return volume and labels of seven things in a row of two layers, none overlapping."""
    volume = np.zeros(SHAPE, np.uint16)
    labels = np.zeros(SHAPE, np.uint16)
    z, y, x = np.indices(SHAPE)

    def put(object_id: int, inside: np.ndarray, density: int) -> None:
        inside = inside & (labels == 0)
        volume[inside], labels[inside] = density, object_id

    def ball(cz: float, cy: float, cx: float, r: float) -> np.ndarray:
        return (z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2 < r**2

    def box(z0: int, z1: int, y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
        return (z >= z0) & (z < z1) & (y >= y0) & (y < y1) & (x >= x0) & (x < x1)

    put(1, ball(10, 12, 12, 9), 1000)
    put(2, box(4, 18, 6, 22, 24, 38), 1400)
    put(3, ball(11, 13, 49, 8), 1100)
    put(4, box(4, 18, 28, 44, 4, 24), 900)
    put(5, ball(10, 36, 36, 9), 1600)
    put(6, box(21, 36, 5, 24, 5, 30), 1200)
    put(7, box(21, 36, 27, 44, 20, 56), 1050)
    return volume, labels


@pytest.fixture
def bag() -> tuple[np.ndarray, np.ndarray]:
    """Return volume and labels of the phantom."""
    return phantom()


@pytest.fixture
def session(bag):
    """Return a session of the phantom, voxels of 1.5 mm."""
    from napari_unpack.session import Session

    return Session(*bag, spacing=(1.5, 1.5, 1.5))


@pytest.fixture
def staged(make_napari_viewer_proxy, session, qtbot):
    """Return (viewer, stage): the phantom on a shown viewer of moderate size, at rest."""
    from napari_unpack.viewer.controller import SessionController

    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(760, 560)
    controller = SessionController(viewer, session)
    controller.seconds = 0.1
    controller.open()
    assert controller.settle(60)
    yield viewer, controller
    controller.close()


@pytest.fixture
def viewer(make_napari_viewer_proxy) -> Any:
    """Return a shown viewer: wide enough for sprites, small for a software rasteriser."""
    made = make_napari_viewer_proxy(show=True)
    made.window.resize(*SMALL)
    return made


@pytest.fixture
def panel(viewer, qtbot) -> Iterator[Any]:
    """Return the panel, docked in the viewer."""
    made = open_panel(viewer, qtbot)
    yield made
    # A viewer that a test closes takes its panel along.
    if not made.workspace.scheduler.closed:
        made.end()


@pytest.fixture
def expert(viewer) -> Any:
    """Return the labels layer of the pile of balls, which is in the viewer."""
    return add_bag(viewer)[1]


@pytest.fixture
def piled(panel, expert, qtbot) -> Any:
    """Return the session of the pile of balls, on its stage by the panel."""
    return controller_with(panel, qtbot, expert)


def canvas(viewer) -> np.ndarray:
    """Return what the canvas shows, (H, W, 3) float."""
    return np.asarray(viewer.screenshot(canvas_only=True, flash=False))[..., :3].astype(float)


def complaints(viewer: Any) -> list[int]:
    """Return the errors that wait in the queue of the viewer's context."""
    from OpenGL import GL

    from napari_unpack.layers import compat

    scene_canvas = compat.native_canvas(viewer)
    scene_canvas.set_current()
    scene_canvas.context.flush_commands()
    found = []
    while len(found) < 9 and (error := GL.glGetError()):
        found.append(error)
    return found
