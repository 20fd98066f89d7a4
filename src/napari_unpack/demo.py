"""`make demo`: the plugin at its main job, on a screen, or as images and a movie without one.

Everything is done through the buttons of the dock widget, so the images show what a user gets.
Flights follow a clock that steps from frame to frame: the movie is smooth on any machine.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.tasks import Progress

if TYPE_CHECKING:
    import napari

    from napari_unpack.io import Scan
    from napari_unpack.viewer.controller import SessionController
    from napari_unpack.widgets.unpacking_widget import UnpackingWidget

Image = NDArray[np.uint8]
FPS = 16
FLIGHT_SECONDS = 0.9
FLIGHTS = 9
"""Enough to see into the bag, in a movie of a quarter of a minute."""

LONGEST_WAIT = 30.0
"""Seconds to wait for what the panel looks for by itself."""

SHAPE = (256, 192, 256)
COUNT = 30
"""A bag that is packed and segmented in about a minute on two cores."""

WINDOW = (1480, 940)
"""Width and height of napari's window, pixels: the panel beside a canvas as wide as the bag."""


class SteppedClock:
    """Time that stands still until it is set."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        """Return the time, s."""
        return self.time


def record(viewer: napari.Viewer, panel: UnpackingWidget, output: Path, progress: Progress) -> None:
    """Write pictures, a movie and a table of an unpacking.

    packed.png, window.png, flight.png, unpacked.png, inspect.png, unpacking.mp4 and objects.csv.

    Parameters
    ----------
    viewer : napari.Viewer
        Shown, on whatever screen.
    panel : UnpackingWidget
        With a session open.
    output : Path
        Folder; made if missing.
    progress : callable
        Takes (fraction, text).
    """
    import imageio.v3 as iio

    from napari_unpack.io import save_objects_csv

    output.mkdir(parents=True, exist_ok=True)
    controller, clock = _controller(panel), SteppedClock()
    controller.session.clock = clock
    # Half a second of the packed bag, before anything moves.
    frames: list[Image] = [_canvas_image(viewer, controller)] * (FPS // 2)
    iio.imwrite(output / "packed.png", frames[0])
    await_unpackable(panel)
    iio.imwrite(output / "window.png", viewer.screenshot(canvas_only=False, flash=False))
    largest = 0
    for k in range(FLIGHTS):
        progress(k / FLIGHTS, "Unpacking")
        before = set(controller.session.poses)
        images = list(_flight(viewer, panel, clock))
        left = sorted(set(controller.session.poses) - before)
        size = int(controller.session.objects.loc[left, "voxels"].sum())
        # The largest object in mid-flight shows best what the plugin does.
        if size > largest:
            largest = size
            iio.imwrite(output / "flight.png", images[len(images) // 2 - 1])
        frames.extend(images)
    frames.extend([_canvas_image(viewer, controller)] * FPS)
    iio.imwrite(output / "unpacked.png", frames[-1])
    progress(0.0, "Inspecting")
    shown = max(controller.session.poses, key=lambda i: controller.session.objects.loc[i, "voxels"])
    panel.commands.inspect(shown)
    # Longer than any animation: the image shall show its end.
    clock.time += 10.0
    iio.imwrite(output / "inspect.png", _canvas_image(viewer, controller))
    panel.commands.leave()
    clock.time += 10.0
    _canvas_image(viewer, controller)
    progress(0.0, "Writing the movie")
    _write_movie(frames, output / "unpacking.mp4")
    save_objects_csv(controller.session, output / "objects.csv")


def _flight(viewer: napari.Viewer, panel: UnpackingWidget, clock: SteppedClock) -> Iterator[Image]:
    """Press Unpack next and yield the canvas from frame to frame until all have landed."""
    controller = _controller(panel)
    controller.seconds = FLIGHT_SECONDS
    panel.unpack.next.click()
    frames = round(FPS * FLIGHT_SECONDS)
    start = clock.time
    for k in range(1, frames + 1):
        # A hair beyond, or the last frame could miss the landing by rounding.
        clock.time = start + FLIGHT_SECONDS * k / frames + 1e-6
        yield _canvas_image(viewer, controller)


def await_unpackable(panel: UnpackingWidget) -> None:
    """Wait until a panel knows what is unpackable, so that its image is a finished one."""
    from qtpy.QtWidgets import QApplication

    from napari_unpack.widgets.section import LAID_OUT_MS

    end = time.monotonic() + LONGEST_WAIT
    while not panel.unpack.answered and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.01)
    # The answer may take more lines than what stood there.
    end = time.monotonic() + LAID_OUT_MS / 1000
    while time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.01)


def _canvas_image(viewer: napari.Viewer, controller: SessionController) -> Image:
    """Return what the canvas shows, (H, W, 3), once every image in it is full and right."""
    controller.step(20.0)
    shown: Image = viewer.screenshot(canvas_only=True, flash=False)[..., :3]
    return shown


def _write_movie(frames: list[Image], path: Path) -> None:
    """Write frames as H.264; an odd edge is cut off, as video wants."""
    from napari_unpack.io.movies import mp4_writer

    height, width = (n // 2 * 2 for n in frames[0].shape[:2])
    with mp4_writer(path, (height, width), FPS) as write:
        for frame in frames:
            write(frame[:height, :width])


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
        # A log file gets one line a step: a bar would fill it with control characters.
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


def run(
    source: Path | None, labels: Path | None, output: Path, seed: int = 0, large: bool = False
) -> None:
    """Open the plugin on a bag, ready to unpack; without a screen, write images and a movie.

    Parameters
    ----------
    source : Path, optional
        A volume; without it a bag is simulated.
    labels : Path, optional
        Labels of the volume; without them it is segmented.
    output : Path
        Folder for images, movie and table where there is no screen.
    seed : int
        Of the simulated bag.
    large : bool
        As for `load_volume`.

    Raises
    ------
    ValueError
        If a file cannot be read, no object is found, or the output can be no folder.
    OSError
        If there is no screen, a virtual one neither, or nothing can be written to the output.
    """
    from napari_unpack.viewer.screen import check_screen

    # Before the long work, and before anything has looked for a screen.
    recorded = bool(os.environ.get("UNPACK_VIRTUAL_SCREEN"))
    if recorded:
        _check_folder(output)
    check_screen()
    steps = Steps()
    scan = _scan(source, labels, seed, large, steps)
    steps(0.0, "Opening napari")
    import napari

    viewer = napari.Viewer(title="napari-unpack", show=True)
    panel = open_panel(viewer, scan, steps)
    controller = _controller(panel)
    # The first image waits for the kernels to be compiled, once a machine.
    controller.settle(300.0)
    steps.done(f"{len(controller.session.ids)} objects; press N to unpack, B to put back")
    if recorded:
        record(viewer, panel, output, steps)
        # Nobody is to be offered it at the next start.
        panel.unsaved.give_up()
        viewer.close()
        steps.done(f"images, movie and table are in {output}/")
    else:
        napari.run()


def _check_folder(output: Path) -> None:
    """Refuse what can be no folder, or is one in which nothing can be written."""
    from napari_unpack.atomic import check_writable

    there = next(place for place in (output, *output.absolute().parents) if place.exists())
    if not there.is_dir():
        raise ValueError(f"{output} cannot be a folder, as {there} is a file: choose another")
    check_writable(there / "packed.png")


def _scan(source: Path | None, labels: Path | None, seed: int, large: bool, steps: Steps) -> Scan:
    from napari_unpack.io import Scan, load_volume
    from napari_unpack.io.labels_on_volume import scan_with_label_file

    if source is None:
        from napari_unpack.simulation import simulate_bag

        steps(0.0, "Packing a bag")
        bag = simulate_bag(
            seed=seed, shape=SHAPE, count=COUNT, progress=_named(steps, "Packing a bag")
        )
        return Scan(bag.volume, bag.spacing, None, "Packed bag")
    steps(0.0, f"Reading {source.name}")
    scan = load_volume(source, large=large)
    return scan if labels is None else scan_with_label_file(scan, labels, large)


def open_panel(viewer: napari.Viewer, scan: Scan, progress: Progress) -> UnpackingWidget:
    """Add a scan to a viewer, dock the panel and press its button; return the panel.

    Parameters
    ----------
    viewer : napari.Viewer
        Gets the layers and the panel.
    scan : Scan
        As from a file.
    progress : callable
        Takes (fraction, text).

    Returns
    -------
    UnpackingWidget
        With a session open.

    Raises
    ------
    ValueError
        If no session could be opened: the volume holds no objects.
    """
    from qtpy.QtWidgets import QApplication

    from napari_unpack.io.napari_reader import label_features, layer_metadata

    viewer.window.resize(*WINDOW)
    placed = {"scale": scan.spacing, "units": ("mm",) * 3, "metadata": layer_metadata(scan)}
    if scan.labels is not None:
        features, name = label_features(scan.names or {}), f"{scan.name} labels"
        viewer.add_labels(scan.labels, name=name, features=features, visible=False, **placed)
    viewer.add_image(scan.volume, name=scan.name, colormap="gray", **placed)
    _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    # Chosen before the button is pressed: the newest Labels layer need not be this one.
    if scan.labels is not None:
        panel.segment.labels_input.choose(viewer.layers[f"{scan.name} labels"])
    QApplication.processEvents()
    panel.segment.progress.progressed.connect(_named(progress, "Segmenting"))
    panel.segment.start.click()
    # The button works on a thread; its events must be handled for it to finish.
    while panel.segment.progress.running:
        QApplication.processEvents()
        time.sleep(0.005)
    QApplication.processEvents()
    if panel.workspace.controller is None:
        raise ValueError(f"{scan.name} could not be opened in the 3D view; see the message above")
    return panel


def _controller(panel: UnpackingWidget) -> SessionController:
    controller = panel.workspace.controller
    assert controller is not None, "a session is open"
    return controller


def _named(progress: Progress, text: str) -> Progress:
    """Report under one text: the steps of a long work are too many for a terminal."""
    return lambda fraction, _: progress(fraction, text)
