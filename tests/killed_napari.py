"""A napari in a process of its own, which a test kills or quits."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from opened_panel import SMALL, add_bag, states


def unpack_for_ever() -> None:
    """Unpack the pile of balls, print what was done once that is on disk, and go on flying."""
    import napari
    from qtpy.QtCore import QTimer

    from napari_unpack.io.recovery import recovery_folder
    from napari_unpack.session import Session
    from napari_unpack.widgets.unpacking_widget import UnpackingWidget

    viewer: Any = napari.Viewer(show=True)
    viewer.window.resize(*SMALL)
    panel = UnpackingWidget(viewer)
    viewer.window.add_dock_widget(panel, name="Virtual Unpacking", area="right")
    image, expert = add_bag(viewer)
    session = Session(image.data, expert.data, spacing=(2.0, 1.0, 1.0))
    panel.workspace.open(session, [image, expert], recolor_at_rest=False)
    session.rename(1, "a knife")
    session.merge([4, 6])
    panel.workspace.controller.seconds = 600.0
    panel.workspace.controller.unpack(3)

    def tell() -> None:
        kept = [p.read_text() for p in recovery_folder().glob("*/*/session.json")]
        # A whole second later than the last change, so that it is in the file.
        if not kept or len(json.loads(kept[-1])["session"]["situation"]["out"]) < 3:
            return
        timer.stop()
        done = {
            "states": {i: s.replace("FLYING_OUT", "UNPACKED") for i, s in states(session).items()},
            "hues": session.hues,
            "names": list(session.objects["name"]),
            "voxels": np.bincount(session.labels.ravel()).tolist(),
        }
        print(json.dumps(done), flush=True)

    timer = QTimer()
    timer.timeout.connect(tell)
    timer.start(100)
    napari.run()


def end_without_closing(worker_sleeps: bool) -> None:
    """Unpack, and end as a script does that never closes its viewer, with a status of its own."""
    import time

    import napari
    from qtpy.QtWidgets import QApplication

    from napari_unpack.io.recovery import recovery_folder
    from napari_unpack.layers import compat
    from napari_unpack.session import Session
    from napari_unpack.tasks import Progress

    viewer: Any = napari.Viewer(show=True)
    viewer.window.resize(*SMALL)
    image, expert = add_bag(viewer)
    _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    panel.workspace.open(Session(image.data, expert.data), [image, expert], recolor_at_rest=False)
    panel.workspace.controller.unpack(1)
    while not list(recovery_folder().glob("*/*/session.json")):
        QApplication.processEvents()
    # Qt tells the active window, and who watches it, when it goes.
    QApplication.setActiveWindow(compat.native_window(viewer))
    # Things fly, and a worker is at work.
    panel.workspace.controller.seconds = 600.0
    panel.workspace.controller.unpack(1)

    def sleep(progress: Progress) -> None:
        for k in range(6000):
            time.sleep(0.1)
            progress(k / 6000, "sleeping")

    if worker_sleeps:
        panel.segment.progress.begin(sleep)
    print("ending", flush=True)
    raise SystemExit(3)


def fail_with_the_viewer_open(with_panel: bool) -> None:
    """Fail as a script does while napari is open and things fly."""
    import napari

    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

    viewer: Any = napari.Viewer(show=True)
    viewer.window.resize(*SMALL)
    image, expert = add_bag(viewer)
    session = Session(image.data, expert.data)
    if with_panel:
        _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
        panel.workspace.open(session, [image, expert], recolor_at_rest=False)
        controller = panel.workspace.controller
    else:
        controller = SessionController(viewer, session)
        controller.open()
    controller.settle(60)
    controller.seconds = 600.0
    controller.unpack(1)
    raise RuntimeError("of the script")


def quit_while_working() -> None:
    """Quit while a worker is in a step that nobody can call off; say when."""
    import time

    import napari
    from qtpy.QtCore import QTimer

    from napari_unpack.layers import compat
    from napari_unpack.widgets.unpacking_widget import UnpackingWidget

    viewer: Any = napari.Viewer(show=True)
    panel = UnpackingWidget(viewer)
    viewer.window.add_dock_widget(panel, name="Virtual Unpacking", area="right")
    panel.segment.progress.begin(lambda _: time.sleep(300))

    def close() -> None:
        print("closing", flush=True)
        compat.native_window(viewer).close(quit_app=True)

    QTimer.singleShot(1000, close)
    napari.run()
    print("closed", flush=True)
