"""`make demo`: the plugin at its main job, on a screen or filmed on a virtual one.

Everything is done through the dock widget's own buttons, so what the pictures show is what a
user gets.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

SHAPE = (256, 192, 256)
COUNT = 30
WINDOW = (1480, 940)


class Steps:
    """A progress bar in the terminal, one line a step."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self._text = ""
        self._drawn = -1

    def __call__(self, fraction: float, text: str) -> None:
        """Show how far a step is; a new text begins a new line."""
        if text != self._text:
            self._end_line()
            self._text, self._drawn = text, -1
        filled = round(24 * min(max(fraction, 0.0), 1.0))
        if filled != self._drawn and sys.stdout.isatty():
            bar = "#" * filled + "." * (24 - filled)
            print(f"\r  [{bar}] {text:<48.48}", end="", flush=True)
        elif self._drawn < 0:
            print(f"  [{self.seconds:5.1f} s] {text}", flush=True)
        self._drawn = filled

    def _end_line(self) -> None:
        if self._text and sys.stdout.isatty():
            print(flush=True)

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._began

    def done(self, text: str) -> None:
        """Say what is done."""
        self._end_line()
        self._text = ""
        print(f"  [{self.seconds:5.1f} s] {text}", flush=True)


def run(source: Path | None, labels: Path | None, output: Path, seed: int = 0) -> None:
    """Open the plugin on a bag, ready to unpack; film it where there is no screen.

    Parameters
    ----------
    source : Path, optional
        A volume; without it a bag is simulated.
    labels : Path, optional
        Labels of the volume; without them it is segmented.
    output : Path
        Folder for pictures, film and table where there is no screen.
    seed : int
        Of the simulated bag.

    Raises
    ------
    ValueError
        If a file cannot be read, or no object is found.
    """
    tell = Steps()
    scan = _scan(source, labels, seed, tell)
    tell(0.0, "Opening napari")
    import napari

    viewer = napari.Viewer(title="napari-unpack", show=True)
    panel = open_panel(viewer, scan, tell)
    stage = panel.workbench.stage
    # The first picture waits for the kernels to be compiled, once a machine.
    stage.settle(300.0)
    tell.done(f"{len(stage.session.ids)} objects; press N to unpack, B to put back")
    if os.environ.get("UNPACK_VIRTUAL_SCREEN"):
        from napari_unpack.widgets.filming import film

        film(viewer, panel, output, tell)
        viewer.close()
        tell.done(f"pictures, film and table are in {output}/")
    else:
        napari.run()


def _scan(source: Path | None, labels: Path | None, seed: int, tell: Steps) -> Any:
    from napari_unpack.io import load_labels, load_volume
    from napari_unpack.io.scan import Scan

    if source is None:
        from napari_unpack.simulation import simulate_bag

        tell(0.0, "Packing a bag")
        bag = simulate_bag(
            seed=seed, shape=SHAPE, count=COUNT, progress=_named(tell, "Packing a bag")
        )
        return Scan(bag.volume, bag.spacing, None, "Packed bag")
    tell(0.0, f"Reading {source.name}")
    scan = load_volume(source)
    return scan if labels is None else scan.with_labels(load_labels(labels)[0])


def open_panel(viewer: Any, scan: Any, tell: Any) -> Any:
    """Add a scan to a viewer, dock the panel and press its button; return the panel.

    Parameters
    ----------
    viewer : napari.Viewer
        Gets the layers and the panel.
    scan : Scan
        Volume, spacing and perhaps labels.
    tell : callable
        Takes (fraction, text).

    Returns
    -------
    UnpackingWidget
        With its stage open.

    Raises
    ------
    ValueError
        If no stage could be opened: the volume holds no objects.
    """
    from qtpy.QtWidgets import QApplication

    viewer.window.resize(*WINDOW)
    placed = {"scale": scan.spacing, "units": ("mm",) * 3}
    if scan.labels is not None:
        viewer.add_labels(scan.labels, name=f"{scan.name} labels", visible=False, **placed)
    viewer.add_image(scan.volume, name=scan.name, colormap="gray", **placed)
    _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    if scan.labels is not None:
        panel.segment.labels_box.choose(viewer.layers[f"{scan.name} labels"])
    QApplication.processEvents()
    panel.segment.waiting.job.progressed.connect(_named(tell, "Segmenting"))
    panel.segment.start.click()
    while panel.segment.waiting.running:
        QApplication.processEvents()
        time.sleep(0.005)
    QApplication.processEvents()
    if panel.workbench.stage is None:
        raise ValueError(f"{scan.name} could not be put on the stage; see the message above")
    return panel


def _named(tell: Any, verb: str) -> Any:
    return lambda fraction, _text: tell(fraction, verb)
