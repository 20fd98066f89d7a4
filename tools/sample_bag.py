"""Unpack the sample bag by the panel's own buttons, as a person does in the first minutes.

`tools/check_dist.py` runs a copy of this file outside the repository.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

OBJECTS = 18
UNPACKED = 3
LONGEST_WAIT = 420.0
"""Seconds for a step: the first one compiles every kernel."""


def main() -> None:
    """Open the sample, segment it, take objects out and put one back."""
    import napari
    from napari.settings import get_settings
    from qtpy.QtCore import QSettings
    from qtpy.QtWidgets import QApplication

    import napari_unpack

    if not Path(napari_unpack.__file__).is_relative_to(sys.prefix):
        raise SystemExit(f"{napari_unpack.__file__} is not the installed package")
    get_settings().config_path = None
    form, scope = QSettings.Format.IniFormat, QSettings.Scope.UserScope
    QSettings.setPath(form, scope, tempfile.mkdtemp())

    def wait(what: str, done: Callable[[], bool]) -> None:
        end = time.monotonic() + LONGEST_WAIT
        while not done():
            if time.monotonic() > end:
                raise SystemExit(f"{what} took longer than {LONGEST_WAIT:.0f} s")
            QApplication.processEvents()
            time.sleep(0.01)

    viewer = napari.Viewer(show=True)
    viewer.open_sample("napari-unpack", "packed_bag")
    _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    wait("an image to segment", panel.segment.start.isEnabled)
    panel.segment.start.click()
    wait("segmenting", lambda: not panel.segment.progress.running)
    controller = panel.workspace.controller
    if controller is None:
        raise SystemExit("no session was opened")
    session = controller.session
    found = len(session.ids)
    # The true number is OBJECTS; as many as this are found by a segmentation that works.
    if not 2 * OBJECTS // 3 <= found <= 2 * OBJECTS:
        raise SystemExit(f"{found} objects were found in a bag of {OBJECTS}")

    def out() -> int:
        return [state.name for state in session.states.values()].count("UNPACKED")

    for _ in range(UNPACKED):
        before = out()
        panel.unpack.next.click()
        wait("unpacking", lambda before=before: out() > before)
    most = out()
    panel.unpack.back.click()
    wait("putting back", lambda: out() < most)
    controller.settle(LONGEST_WAIT)
    picture = viewer.screenshot(canvas_only=True, flash=False)[..., :3]
    if len({tuple(pixel) for row in picture[::8, ::8] for pixel in row}) < 50:
        raise SystemExit("the canvas shows next to no colours")
    print(f"{found} objects, {most} came out, one went back")
    panel.unsaved.give_up()
    viewer.close()


if __name__ == "__main__":
    main()
