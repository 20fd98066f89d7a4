"""A story on the real plugin, watched for stalls: from an empty viewer to slices of an open bag.

    python -m benchmarks.story [VOLUME.npz]
    python -m benchmarks.story --alone [VOLUME.npz]

`--alone` does to napari what the plugin does, without the plugin: layers added and removed, 3D and
back. Prints a line a phase: `stall`, its name, the longest stall, the most of one in our code, and
of that on the main thread's processor, all in ms, and where.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import napari
import numpy as np
from qtpy.QtCore import QEventLoop, QTimer
from qtpy.QtWidgets import QApplication

from benchmarks.event_loop import EventLoopWatch

WINDOW = (1200, 800)
# Long enough for all that is done at rest after a phase.
REST_SECONDS = 2.0
PATIENCE_SECONDS = 600.0


def wait(condition: Callable[[], bool]) -> None:
    """Let the event loop turn until something holds.

    Raises
    ------
    TimeoutError
        If it does not for ten minutes.
    """
    end = time.monotonic() + PATIENCE_SECONDS
    while not condition():
        QApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 20)
        time.sleep(0.001)
        if time.monotonic() > end:
            raise TimeoutError("the story does not go on")


def rest(seconds: float = REST_SECONDS) -> None:
    """Let the event loop turn for so long."""
    end = time.monotonic() + seconds
    wait(lambda: time.monotonic() > end)


def settled(panel: Any) -> None:
    """Wait until a session is open and at rest."""
    workspace = panel.workspace
    wait(lambda: workspace.controller is not None)
    # Not `settle`, which would handle events within our own code.
    wait(lambda: not workspace.scheduler.busy and not workspace.controller.scheduler.busy)
    rest()


def with_plugin(viewer: Any, watch: EventLoopWatch, volume: Path | None) -> None:
    """Live the story.

    Parameters
    ----------
    viewer : napari.Viewer
    watch : EventLoopWatch
    volume : Path, optional
        An .npz of a volume; by default the sample.
    """
    watch.phase = "open the panel"
    _, panel = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    commands, workspace = panel.commands, panel.workspace
    rest()
    watch.phase = "open the volume"
    if volume is None:
        QTimer.singleShot(0, lambda: viewer.open_sample("napari-unpack", "packed_bag"))
        wait(lambda: len(viewer.layers) == 2)
        panel.segment.labels_input.choose(None)
    else:
        _add(viewer, *_read(volume))
    rest()
    watch.phase = "segment"
    panel.segment.start.click()
    settled(panel)
    watch.phase = "unpack"
    for _ in range(2):
        commands.unpack(1)
        rest()
    watch.phase = "fast N"
    for _ in range(6):
        commands.unpack(1)
        rest(0.12)
    settled(panel)
    watch.phase = "turn"
    for _ in range(20):
        camera = viewer.scene.camera
        camera.angles = tuple(np.add(camera.angles, (0, 4, 3)))
        rest(0.03)
    settled(panel)
    with tempfile.TemporaryDirectory() as folder:
        watch.phase = "save the session"
        panel.files.save_to(Path(folder) / "story.unpack")
        wait(lambda: not panel.files.progress.running)
        watch.phase = "open the session"
        before = workspace.controller
        panel.files.open_from(Path(folder) / "story.unpack")
        wait(lambda: workspace.controller not in (None, before))
        settled(panel)
    watch.phase = "open a container"
    if _opened(panel):
        settled(panel)
        watch.phase = "back to the bag"
        commands.leave_container()
        settled(panel)
    watch.phase = "slices and back"
    for dimensions in (2, 3):
        viewer.dims.ndisplay = dimensions
        rest()


def _opened(panel: Any) -> bool:
    """Open the largest object that can be opened."""
    commands, workspace = panel.commands, panel.workspace
    sizes = workspace.session.objects["voxels"]
    for object_id in sorted(workspace.session.ids, key=lambda i: -sizes[i])[:6]:
        commands.inspect(object_id)
        settled(panel)
        commands.open_container(object_id)
        if workspace.is_inside:
            return True
        commands.leave()
        settled(panel)
    return False


def alone(viewer: Any, watch: EventLoopWatch, volume: Path | None) -> None:
    """Do the same to napari without the plugin.

    Parameters
    ----------
    viewer : napari.Viewer
    watch : EventLoopWatch
    volume : Path, optional
        As for `with_plugin`.
    """
    from napari.utils.colormaps import DirectLabelColormap

    if volume is None:
        from napari_unpack.widgets.contributions import packed_bag

        (array, about, _), (ids, _, _) = packed_bag()
        spacing = about["scale"]
    else:
        array, spacing = _read(volume)
        ids = (array > np.percentile(array, 90)).astype(np.int32)
    rest()
    watch.stalls.clear()
    watch.phase = "add an image"
    _add(viewer, array, spacing)
    rest()
    watch.phase = "add labels in colours"
    labels = viewer.add_labels(ids, scale=spacing, units=("mm",) * 3)
    rest()
    labels.colormap = DirectLabelColormap(
        color_dict={None: np.zeros(4), 0: np.zeros(4), **{i: np.ones(4) for i in range(1, 30)}}
    )
    rest()
    watch.phase = "to 3D"
    viewer.dims.ndisplay = 3
    rest()
    watch.phase = "add three layers"
    added = [viewer.add_image(np.zeros((64, 64, 4), np.uint8), rgb=True) for _ in range(3)]
    rest()
    watch.phase = "remove three layers"
    with viewer.layers.batched_update():
        for layer in added:
            viewer.layers.remove(layer)
    rest()
    watch.phase = "slices and back"
    for dimensions in (2, 3):
        viewer.dims.ndisplay = dimensions
        rest()


def _read(path: Path) -> tuple[Any, tuple[float, ...]]:
    held = np.load(path)
    array = next(held[name] for name in held if held[name].ndim == 3)
    spacing = tuple(held["spacing"]) if "spacing" in held else (1.0, 1.0, 1.0)
    return array, spacing


def _add(viewer: Any, array: Any, spacing: tuple[float, ...]) -> None:
    viewer.add_image(array, name="volume", scale=spacing, units=("mm",) * 3)


def main(arguments: list[str]) -> None:
    """Watch a story and print its stalls."""
    volumes = [Path(each) for each in arguments if not each.startswith("-")]
    viewer = napari.Viewer(show=True)
    viewer.window.resize(*WINDOW)
    rest()
    watch = EventLoopWatch()
    watch.start()
    live = alone if "--alone" in arguments else with_plugin
    live(viewer, watch, volumes[0] if volumes else None)
    watch.stop()
    for phase in dict.fromkeys(stall.phase for stall in watch.stalls):
        found = [stall for stall in watch.stalls if stall.phase == phase]
        worst = watch.longest(phase)
        numbers = max(s.seconds for s in found), worst.ours, max(s.ours_cpu for s in found)
        print("stall", phase.replace(" ", "_"), *(round(1000 * n) for n in numbers), worst.where)
    sys.stdout.flush()
    # Threads of kernels may still run; nothing of theirs is wanted.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
