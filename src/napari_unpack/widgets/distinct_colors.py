"""Two commands on any Labels layer: distinct colours for this view, and the old ones back."""

from __future__ import annotations

from typing import Any

import napari
from napari.layers import Labels

from napari_unpack.widgets.notices import inform, spoken


def distinct_colors(viewer: napari.Viewer) -> Any:
    """Give objects that are near one another in the view colours that are far apart.

    Parameters
    ----------
    viewer : napari.Viewer
        Its active Labels layer is coloured, or its only one.

    Returns
    -------
    worker or None
        What works out the colours; None where there is no such layer.
    """
    from napari.qt.threading import create_worker

    from napari_unpack.layers.distinct_colors import put_on, question

    layer = _layer(viewer)
    if layer is None:
        return None
    with spoken():
        asked = question(viewer, layer)
        worker: Any = create_worker(
            asked.answer, _start_thread=False, _progress={"desc": "Distinct colours"}
        )
        worker.returned.connect(
            lambda colors: put_on(layer, colors) if layer in viewer.layers else None
        )
        worker.errored.connect(lambda error: inform(f"No colours could be chosen: {error}"))
        worker.start()
        return worker
    return None


def restore_colors(viewer: napari.Viewer) -> None:
    """Give the active Labels layer, or the only one, the colours it had before.

    Parameters
    ----------
    viewer : napari.Viewer
    """
    from napari_unpack.layers.distinct_colors import give_back

    layer = _layer(viewer)
    if layer is not None and not give_back(layer):
        inform(f"{layer.name} has the colours it always had.")


def _layer(viewer: napari.Viewer) -> Labels | None:
    active = viewer.layers.selection.active
    if isinstance(active, Labels):
        return active
    some = [layer for layer in viewer.layers if isinstance(layer, Labels)]
    if len(some) == 1:
        return some[0]
    inform(
        "Select the Labels layer to colour." if some else "Distinct colours need a Labels layer."
    )
    return None
