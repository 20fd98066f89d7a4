"""Pictures and a film of the plugin at work, for a machine without a screen.

Flights are driven by a clock that steps from frame to frame, so the film is smooth however slow
the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
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
    stage, clock = panel.workbench.stage, SteppedClock()
    stage.session.clock = clock
    frames: list[Picture] = [picture(viewer, stage)] * (FPS // 2)
    iio.imwrite(output / "packed.png", frames[0])
    await_answers(panel)
    iio.imwrite(output / "window.png", viewer.screenshot(canvas_only=False, flash=False))
    largest = 0
    for k in range(FLIGHTS):
        tell(k / FLIGHTS, "Unpacking")
        before = set(stage.session.poses)
        shots = list(flight(viewer, panel, clock))
        left = sorted(set(stage.session.poses) - before)
        size = int(stage.session.objects.loc[left, "voxels"].sum())
        if size > largest:
            largest = size
            iio.imwrite(output / "flight.png", shots[len(shots) // 2 - 1])
        frames.extend(shots)
    frames.extend([picture(viewer, stage)] * FPS)
    iio.imwrite(output / "unpacked.png", frames[-1])
    tell(0.0, "Inspecting")
    shown = max(stage.session.poses, key=lambda i: stage.session.objects.loc[i, "voxels"])
    panel.workbench.inspect(shown)
    clock.time += 10.0
    iio.imwrite(output / "inspect.png", picture(viewer, stage))
    panel.workbench.leave()
    clock.time += 10.0
    picture(viewer, stage)
    tell(0.0, "Writing the film")
    write_film(frames, output / "unpacking.mp4")
    save_objects_csv(stage.session.objects, output / "objects.csv")


def flight(viewer: Any, panel: Any, clock: SteppedClock) -> Iterator[Picture]:
    """Press Unpack next and yield the canvas from frame to frame until all have landed."""
    stage = panel.workbench.stage
    stage.seconds = FLIGHT_SECONDS
    panel.unpack.next.click()
    frames = round(FPS * FLIGHT_SECONDS)
    start = clock.time
    for k in range(1, frames + 1):
        clock.time = start + FLIGHT_SECONDS * k / frames + 1e-6
        yield picture(viewer, stage)


def await_answers(panel: Any, seconds: float = PATIENCE) -> None:
    """Wait until the panel has found out who can leave, so that its picture is a finished one."""
    from qtpy.QtWidgets import QApplication

    end = monotonic() + seconds
    while not panel.unpack.answered and monotonic() < end:
        QApplication.processEvents()
        sleep(0.01)


def picture(viewer: Any, stage: Any) -> Picture:
    """Return what the canvas shows once every picture in it is full and right, (H, W, 3)."""
    stage.step(20.0)
    shot: Picture = viewer.screenshot(canvas_only=True, flash=False)[..., :3]
    return shot


def write_film(frames: list[Picture], path: Path) -> None:
    """Write frames as an H.264 film; an odd edge is cut off, as video wants."""
    from napari_unpack.io.film_files import mp4_writer

    height, width = (n // 2 * 2 for n in frames[0].shape[:2])
    with mp4_writer(path, (height, width), FPS) as write:
        for frame in frames:
            write(frame[:height, :width])
