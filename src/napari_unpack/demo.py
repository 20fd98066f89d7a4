"""`make demo`: the plugin at its main job, on a screen or filmed on a virtual one.

Everything is done through the dock widget's own buttons, so what the pictures show is what a
user gets.

Pictures and a film of the plugin at work, for a machine without a screen.

Flights are driven by a clock that steps from frame to frame, so the film is smooth however slow
the machine.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
from numpy.typing import NDArray

ImageTexture = NDArray[np.uint8]
FPS = 16
FLIGHT_SECONDS = 0.9
FLIGHTS = 9
PATIENCE = 30.0
"""Seconds to wait for what the panel looks for by itself."""


class SteppedClock:
    """Time that stands still until it is set."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        """Return the time, s."""
        return self.time


def film(viewer: Any, panel: Any, output: Path, tell: Callable[[float, str], None]) -> None:
    """Write packed.png, flight.png, unpacked.png, inspect.png, unpacking.mp4 and objects.csv.

    Parameters
    ----------
    viewer : napari.Viewer
        Shown, on whatever screen.
    panel : UnpackingWidget
        With its stage open.
    output : Path
        Folder; made if missing.
    tell : callable
        Takes (fraction, text).
    """
    import imageio.v3 as iio

    from napari_unpack.io import save_objects_csv

    output.mkdir(parents=True, exist_ok=True)
    controller, clock = panel.workspace.controller, SteppedClock()
    controller.session.clock = clock
    frames: list[ImageTexture] = [picture(viewer, controller)] * (FPS // 2)
    iio.imwrite(output / "packed.png", frames[0])
    await_answers(panel)
    iio.imwrite(output / "window.png", viewer.screenshot(canvas_only=False, flash=False))
    largest = 0
    for k in range(FLIGHTS):
        tell(k / FLIGHTS, "Unpacking")
        before = set(controller.session.poses)
        shots = list(flight(viewer, panel, clock))
        left = sorted(set(controller.session.poses) - before)
        size = int(controller.session.objects.loc[left, "voxels"].sum())
        if size > largest:
            largest = size
            iio.imwrite(output / "flight.png", shots[len(shots) // 2 - 1])
        frames.extend(shots)
    frames.extend([picture(viewer, controller)] * FPS)
    iio.imwrite(output / "unpacked.png", frames[-1])
    tell(0.0, "Inspecting")
    shown = max(controller.session.poses, key=lambda i: controller.session.objects.loc[i, "voxels"])
    panel.workspace.inspect(shown)
    clock.time += 10.0
    iio.imwrite(output / "inspect.png", picture(viewer, controller))
    panel.workspace.leave()
    clock.time += 10.0
    picture(viewer, controller)
    tell(0.0, "Writing the film")
    write_film(frames, output / "unpacking.mp4")
    save_objects_csv(controller.session.objects, output / "objects.csv")


def flight(viewer: Any, panel: Any, clock: SteppedClock) -> Iterator[ImageTexture]:
    """Press Unpack next and yield the canvas from frame to frame until all have landed."""
    controller = panel.workspace.controller
    controller.seconds = FLIGHT_SECONDS
    panel.unpack.next.click()
    frames = round(FPS * FLIGHT_SECONDS)
    start = clock.time
    for k in range(1, frames + 1):
        clock.time = start + FLIGHT_SECONDS * k / frames + 1e-6
        yield picture(viewer, controller)


def await_answers(panel: Any, seconds: float = PATIENCE) -> None:
    """Wait until the panel has found out who can leave, so that its picture is a finished one."""
    from qtpy.QtWidgets import QApplication

    end = monotonic() + seconds
    while not panel.unpack.answered and monotonic() < end:
        QApplication.processEvents()
        sleep(0.01)


def picture(viewer: Any, controller: Any) -> ImageTexture:
    """Return what the canvas shows once every picture in it is full and right, (H, W, 3)."""
    controller.step(20.0)
    shot: ImageTexture = viewer.screenshot(canvas_only=True, flash=False)[..., :3]
    return shot


def write_film(frames: list[ImageTexture], path: Path) -> None:
    """Write frames as an H.264 film; an odd edge is cut off, as video wants."""
    from napari_unpack.io.movies import mp4_writer

    height, width = (n // 2 * 2 for n in frames[0].shape[:2])
    with mp4_writer(path, (height, width), FPS) as write:
        for frame in frames:
            write(frame[:height, :width])


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
    controller = panel.workspace.controller
    # The first picture waits for the kernels to be compiled, once a machine.
    controller.settle(300.0)
    tell.done(f"{len(controller.session.ids)} objects; press N to unpack, B to put back")
    if os.environ.get("UNPACK_VIRTUAL_SCREEN"):
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
    if panel.workspace.controller is None:
        raise ValueError(f"{scan.name} could not be put on the stage; see the message above")
    return panel


def _named(tell: Any, verb: str) -> Any:
    return lambda fraction, _text: tell(fraction, verb)
