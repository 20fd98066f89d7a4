"""What the manifest offers beside the panel: two commands, sample data, a reader of sessions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from napari.layers import Labels

from napari_unpack.layers import compat
from napari_unpack.tasks import Progress, Task
from napari_unpack.viewer.scheduler import Scheduler, Worker, on_main_thread
from napari_unpack.widgets.large_files import READ_ELSEWHERE, LayerData
from napari_unpack.widgets.notifications import errors_shown, inform

if TYPE_CHECKING:
    import napari
    from napari.utils.colormaps import DirectLabelColormap

    from napari_unpack.session import Session
    from napari_unpack.widgets.unpacking_widget import UnpackingWidget

PLUGIN, PANEL = "napari-unpack", "Virtual Unpacking"

# Voxels and objects of the sample: segmented in seconds, yet some objects block others.
SAMPLE_SHAPE, SAMPLE_COUNT = (96, 120, 144), 18


def distinct_colors(viewer: napari.Viewer) -> Scheduler | None:
    """Give objects that are near one another in the view colours that are far apart.

    Parameters
    ----------
    viewer : napari.Viewer
        Its active Labels layer is coloured, or its only one.

    Returns
    -------
    Scheduler or None
        It works out the colours and is then closed; None where there is no such layer.
    """
    from napari.utils import progress

    from napari_unpack.viewer.view_colors import color_task, put_on

    layer = _labels_layer(viewer)
    if layer is None:
        return None
    with errors_shown():
        task = color_task(viewer, layer)
        # This command has no panel, so it shows its progress in napari's activity dock.
        bar, scheduler = progress(total=0, desc="Distinct colours"), Scheduler()

        def end() -> None:
            bar.close()
            scheduler.close()

        def done(colors: DirectLabelColormap) -> None:
            end()
            # The layer may have been removed meanwhile.
            if layer in viewer.layers:
                put_on(layer, colors)

        def failed(error: Exception) -> None:
            end()
            inform(f"No colours could be chosen: {error}")

        scheduler.submit(task, Worker.LONG, done, failed=failed)
        return scheduler
    return None


def restore_colors(viewer: napari.Viewer) -> None:
    """Give the active Labels layer, or the only one, the colours it had before."""
    from napari_unpack.viewer.view_colors import give_back

    layer = _labels_layer(viewer)
    if layer is not None and not give_back(layer):
        inform(f"The colours of {layer.name} have not been changed.")


def _labels_layer(viewer: napari.Viewer) -> Labels | None:
    # Not the proxy that a menu hands over: its layers are made anew whenever they are asked for,
    # and what is known of one is forgotten with it.
    layers = compat.unwrap(viewer).layers
    active = layers.selection.active
    if isinstance(active, Labels):
        return active
    some = [layer for layer in layers if isinstance(layer, Labels)]
    if len(some) == 1:
        return some[0]
    inform(
        "Select the Labels layer to colour." if some else "Distinct colours need a Labels layer."
    )
    return None


def packed_bag(progress: Progress | None = None) -> list[LayerData]:
    """Simulate a small bag and its true objects.

    Parameters
    ----------
    progress : callable, optional
        Takes (fraction in [0, 1], text); raises to cancel.

    Returns
    -------
    list of (array, dict, str)
        The density volume, and above it the labels of the true objects, not shown: the volume is
        the one to segment.
    """
    from napari_unpack.simulation import simulate_bag

    bag = simulate_bag(seed=4, shape=SAMPLE_SHAPE, count=SAMPLE_COUNT, progress=progress)
    placed = {"scale": tuple(float(s) for s in bag.spacing), "units": ("mm",) * 3}
    features = {"index": list(bag.objects.index), "name": list(bag.objects["name"])}
    truth = {"name": "Packed bag, true objects", "visible": False, "features": features}
    shown = {
        "name": "Packed bag",
        "colormap": "gray",
        # From air to dense plastic; metal alone is brighter.
        "contrast_limits": (0, 3000),
        "rendering": "attenuated_mip",
    }
    return [(bag.volume, shown | placed, "image"), (bag.labels, truth | placed, "labels")]


def nuclei(progress: Progress | None = None) -> list[LayerData]:
    """Simulate the nuclei of an embryo under a microscope; otherwise as `packed_bag`."""
    from napari_unpack.simulation.nuclei import simulate_nuclei

    made = simulate_nuclei(0, progress=progress)
    placed = {"scale": made.spacing, "units": ("um",) * 3}
    shown = {"name": "Nuclei", "colormap": "gray", "contrast_limits": (0, 900)}
    truth = {"name": "Nuclei, true objects", "visible": False}
    return [(made.volume, shown | placed, "image"), (made.labels, truth | placed, "labels")]


def packed_bag_sample() -> list[LayerData]:
    """Return `packed_bag()` to napari, which asks for it on its main thread, drawing meanwhile."""
    return _made("Packing a bag", packed_bag)


def nuclei_sample() -> list[LayerData]:
    """Return `nuclei()` to napari, as `packed_bag_sample` its bag."""
    return _made("Growing nuclei", nuclei)


def _made(text: str, make: Callable[[Progress | None], list[LayerData]]) -> list[LayerData]:
    from napari.utils import progress

    if not on_main_thread():
        return make(None)
    scheduler = Scheduler(inform)
    with progress(total=0, desc=text):
        made = scheduler.run_modal(Task(text, make), Worker.LONG)
    scheduler.close()
    # Where it failed the reason has been told.
    return made or READ_ELSEWHERE


def get_session_reader(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """Return a reader for a saved session, None where it is none; looks at names alone.

    Parameters
    ----------
    path : str or sequence of str
        What napari was asked to open.
    """
    from napari_unpack.io.session_archive import holds_session

    if not isinstance(path, str):
        if len(path) != 1:
            return None
        path = path[0]
    return open_dropped if holds_session(Path(path)) else None


def open_dropped(path: str | Sequence[str]) -> list[LayerData]:
    """Open a session in the panel; without a viewer, as an Image and Labels.

    Parameters
    ----------
    path : str or sequence of str
        As for `get_session_reader`.

    Returns
    -------
    list of (data, attributes, layer type)
        No layers where the panel opens the session, in a worker.
    """
    # napari hands over a list when one file is dropped.
    first = Path(path if isinstance(path, str) else path[0])
    viewer = compat.viewer_dropped_on()
    if viewer is not None:
        _shown_panel(viewer).files.open_from(first)
        return READ_ELSEWHERE
    return _layers(first)


def _shown_panel(viewer: napari.Viewer) -> UnpackingWidget:
    """Return the panel of a viewer in its dock, or in a new one."""
    from qtpy.QtWidgets import QDockWidget

    from napari_unpack.widgets.unpacking_widget import panel_of

    panel = panel_of(viewer)
    dock = None if panel is None else panel.parent()
    # Not asked of napari at once: by another name than its menu it would make another dock.
    if panel is None or not isinstance(dock, QDockWidget):
        dock, panel = viewer.window.add_plugin_dock_widget(PLUGIN, PANEL)
    # It may be hidden, and its progress with it.
    dock.show()
    return panel


def told_of_file(session: Session) -> dict[str, Any]:
    """Return what a session knows of its scan's file, as metadata of a layer.

    `layers.placement` reads it.
    """
    return {"scanner_from_scan": session.scanner_from_scan, "assumed": session.assumed}


def _layers(path: Path) -> list[LayerData]:
    from napari_unpack.io import open_session
    from napari_unpack.io.session_json import given_labels
    from napari_unpack.io.sessions import standing_of
    from napari_unpack.rendering.slice_image import object_window

    session = open_session(path)
    about: dict[str, Any] = {"scale": tuple(session.spacing), "units": ("mm",) * 3}
    about["affine"] = standing_of(path)
    about["metadata"] = told_of_file(session)
    limits = object_window(session.volume, session.labels)
    shown = {"name": path.stem, "colormap": "gray", "contrast_limits": limits}
    return [
        (session.volume, {**about, **shown}, "image"),
        (given_labels(session), {**about, "name": f"{path.stem} objects"}, "labels"),
    ]
