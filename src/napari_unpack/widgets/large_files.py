"""Volumes for napari, with a question before one is read that would fill the memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from napari_unpack.file_sizes import TooLargeError
from napari_unpack.io.napari_reader import get_reader, read_layers

if TYPE_CHECKING:
    from qtpy.QtWidgets import QMessageBox, QWidget

# As napari's readers return layers: (data, attributes, layer type).
LayerData = tuple[Any, ...]

# napari's answer of a reader that needs no layers added.
READ_ELSEWHERE: list[LayerData] = [(None,)]


def get_volume_reader(
    path: str | Sequence[str],
) -> Callable[[str | Sequence[str]], list[LayerData]] | None:
    """Return a reader that asks before it fills the memory; None where the file is not ours.

    Parameters
    ----------
    path : str or sequence of str
        What napari was asked to open.
    """
    return None if get_reader(path) is None else read_volume


def read_volume(path: str | Sequence[str]) -> list[LayerData]:
    """Read a volume; one that is too large once a person has said so, into layers of its own.

    Parameters
    ----------
    path : str or sequence of str

    Returns
    -------
    list of (data, attributes, layer type)
        No layers where the person is asked.
    """
    from napari_unpack.layers.compat import native_window, viewer_dropped_on

    viewer = viewer_dropped_on()
    try:
        return read_layers(path)
    except TooLargeError as error:
        if viewer is None:
            raise

        from napari.layers import Layer

        from napari_unpack.widgets.notifications import errors_shown

        def read() -> None:
            with errors_shown():
                for data in read_layers(path, large=True):
                    viewer.add_layer(Layer.create(*data))

        ask_about_size(native_window(viewer), error, read)
        return READ_ELSEWHERE


def ask_about_size(parent: QWidget | None, error: TooLargeError, then: Callable[[], None]) -> None:
    """Show why a file was not opened, and open it all the same where that is the answer.

    Parameters
    ----------
    parent : QWidget, optional
        The question is shown over it.
    error : TooLargeError
    then : callable
        Called where the answer is Open.
    """
    # Imported late: volumes are read by napari without a window too.
    from qtpy.QtCore import Qt
    from qtpy.QtWidgets import QMessageBox

    box = QMessageBox(parent)
    box.setIcon(QMessageBox.Icon.Warning)
    box.setWindowTitle("Virtual Unpacking")
    box.setTextFormat(Qt.TextFormat.PlainText)
    box.setText(f"{error.reason}.")
    box.setInformativeText(
        "Open it all the same? Where memory runs out, the computer stands still or ends napari."
    )
    kinds = QMessageBox.StandardButton
    box.setStandardButtons(kinds.Open | kinds.Cancel)
    box.setDefaultButton(kinds.Cancel)
    box.finished.connect(partial(_answer, box, kinds.Open, then))
    # Not `exec`, which would run everything else within this call.
    box.open()


def _answer(box: QMessageBox, yes: object, then: Callable[[], None], _result: int) -> None:
    clicked = box.clickedButton()
    box.deleteLater()
    if clicked is not None and box.standardButton(clicked) == yes:
        then()
