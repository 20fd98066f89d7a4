"""Names in the picture: beside sprites, switched and remembered, and under the mouse."""

import errno
from itertools import combinations
from typing import Any

import numpy as np
from napari.settings import get_plugin_settings
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QToolTip

from mouse import move
from napari_unpack.layers import compat
from napari_unpack.session.quantities import angle_words, length_words, volume_words
from napari_unpack.viewer.canvas_text import CanvasText
from napari_unpack.widgets.background_options import BackgroundOptions
from opened_panel import rest
from viewer_fixtures import canvas


def test_names_stand_beside_sprites_and_under_the_mouse(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot, request: Any
) -> None:
    session, controller = piled, panel.workspace.controller
    controller.recolor_at_rest, controller.seconds = False, 0.05
    out = controller.unpack(4)
    session.rename(out[0], "A name so long that it would cover what lies beside its object")
    rest(panel, qtbot)
    widget = compat.native_canvas(viewer).native
    before, box = canvas(viewer), panel.color.background.names
    box.setChecked(False)
    request.addfinalizer(lambda: box.setChecked(False))
    qtbot.keyClick(widget, Qt.Key.Key_T)
    assert box.isChecked()
    changed = np.abs(canvas(viewer) - before).max(axis=-1) > 60
    written = {i: spot for i, spot, _ in controller.names.written_at(controller.frame)}
    assert set(written) == set(out)
    # Drawn again where nothing has moved, they need not find their places anew.
    places = controller.names.written_at
    assert places(controller.frame) is places(controller.frame)
    seen = np.zeros_like(changed)
    for (top, left), (bottom, right) in np.round(list(written.values())).astype(int):
        seen[top:bottom, left:right] = True
        assert changed[top:bottom, left:right].sum() > 50
    assert not (changed & ~seen).any()
    for a, b in combinations(written.values(), 2):
        assert (np.minimum(a[1], b[1]) <= np.maximum(a[0], b[0])).any()
    # Dark letters on a light ground.
    panel.color.background.choose("Light")
    rest(panel, qtbot)
    top, left = np.round(written[out[1]][0]).astype(int)
    bottom, right = np.round(written[out[1]][1]).astype(int)
    name = canvas(viewer)[top:bottom, left:right]
    assert name.min() < 70
    assert np.median(name) > 180
    # The next panel begins as this one was left.
    assert BackgroundOptions(panel.workspace, panel.commands).names.isChecked()
    qtbot.keyClick(widget, Qt.Key.Key_T)
    assert not BackgroundOptions(panel.workspace, panel.commands).names.isChecked()

    def told_at(spot: QPoint, words: str) -> bool:
        # Qt takes a tip away whenever a window comes or goes: the mouse comes again then.
        for place in (QPoint(3, 3), spot + QPoint(2, 2), spot):
            move(widget, place)
            qtbot.wait(10)
        return QToolTip.text().startswith(words)

    # Name and volume are told over what is in the bag and over what is out.
    sprite = controller.frame.camera.pixels(session.poses[out[1]].center, controller.frame.size)
    left_in = next(i for i in session.ids if i not in out)
    packed = session.boxes.center(left_in, session.spacing)
    inside = controller.frame.camera.project(packed, controller.frame.size)
    for row, col in (sprite, inside):
        spot = QPoint(round(col), round(row))
        there = controller.interaction
        pixel = np.array([row, col])
        wanted = there.sprite_at(pixel) or there.packed_at(pixel)[0]
        words = str(session.objects["name"][wanted])
        qtbot.waitUntil(lambda spot=spot, words=words: told_at(spot, words), timeout=5000)
        assert QToolTip.text().endswith("cm³")
    move(widget, QPoint(3, 3))
    qtbot.waitUntil(lambda: not QToolTip.isVisible(), timeout=5000)


def test_names_are_shown_also_where_settings_cannot_be_kept(
    panel: Any, piled: Any, viewer: Any, qtbot: QtBot, request: Any
) -> None:
    stored, notices = get_plugin_settings("napari-unpack").drawing, []

    def full(_event: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def noticed(notice: Any) -> None:
        notices.append(notice.message)

    stored.events.names.connect(full)
    notification_manager.notification_ready.connect(noticed)
    request.addfinalizer(lambda: notification_manager.notification_ready.disconnect(noticed))
    request.addfinalizer(lambda: setattr(stored, "names", False))
    request.addfinalizer(lambda: stored.events.names.disconnect(full))
    box, names = panel.color.background.names, panel.workspace.controller.names
    for shown in (not names.shown, names.shown, not names.shown):
        box.setChecked(shown)
        assert names.shown is shown
    assert notices == ["Not remembered for the next start: No space left on device."]


def test_quantities_have_the_unit_that_can_be_read() -> None:
    assert [length_words(mm) for mm in (1234.0, 123.4, 12.34, 1.234, 0.0123)] == [
        "1.23 m",
        "123 mm",
        "12.3 mm",
        "1.23 mm",
        "12.3 \N{MICRO SIGN}m",
    ]
    # What rounds to the next unit, or to one digit more before the point.
    assert [length_words(mm) for mm in (999.6, 999.4, 0.9996, 9.996, 99.96)] == [
        "1.00 m",
        "999 mm",
        "1.00 mm",
        "10.0 mm",
        "100 mm",
    ]
    assert volume_words(999.6) == "1.00 cm³"
    assert [volume_words(mm3) for mm3 in (185000.0, 999.0, 1.0, 1e-6)] == [
        "185 cm³",
        "999 mm³",
        "1.00 mm³",
        "1000 \N{MICRO SIGN}m³",
    ]
    assert angle_words(90.04) == "90.0°"


def test_words_are_drawn_anew_only_where_others_are_read(qapp: Any) -> None:
    text = CanvasText(lambda: 1.0)
    name = "A name so long that it loses its middle"
    short = [text.image("Tin", False, longest) for longest in (300, 301, np.inf)]
    assert short[0] is short[1] is short[2]
    whole, cut = text.image(name, False), text.image(name, False, 100)
    assert cut.size[1] <= 100 < whole.size[1]
    assert text.image(name, False, 5000) is whole
    assert text.image(name, False, 100) is cut
    assert text.image("Tin", True) is not short[0]
