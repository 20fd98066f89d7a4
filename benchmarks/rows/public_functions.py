"""The public functions against the casts that they call, from several views, arrays never seen.

The inner cast of an image is given its bricks. Those of IDs and of occlusion take no longer than
to look at every voxel once, so they make theirs in the call, as any first call must.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.row import Row, ms, paired_ms
from benchmarks.scenes import MM, SHADING, Scenes

WHAT = "public functions"
WORK = "256x256x512, 27 objects, three views; render 1024x1024, IDs and occlusion 512x512; CPU time"
GOAL = "<= 1.3x the inner cast, first call"
MOST = 1.3
# Along an axis, and two between them: rows of the volume are read across in these.
DIRECTIONS = ((0.0, 0.0, 1.0), (0.5, 0.35, 1.0), (1.0, -0.7, 0.3))


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering.gl import offscreen

    rows = [_row(scenes, "cpu")]
    if offscreen.available():
        return [*rows, _row(scenes, "gl")]
    return [*rows, Row.not_measured(f"{WHAT}, gl", WORK, "no GL context", GOAL)]


def _row(scenes: Scenes, backend: str) -> Row:
    found = {name: _slowest(scenes, backend, name) for name in _PAIRS}
    ours = ", ".join(f"{name} {ms(times[0])}" for name, times in found.items())
    casts = ", ".join(ms(times[1]) for times in found.values())
    ratios = [times[2] for times in found.values()]
    return Row(
        f"{WHAT}, {backend}",
        WORK,
        ours,
        f"inner casts: {casts}",
        ", ".join(f"{ratio:.2f}" for ratio in ratios),
        GOAL,
        max(ratios) <= MOST,
    )


def _slowest(scenes: Scenes, backend: str, name: str) -> tuple[float, float, float]:
    """Return ms, ms of the inner cast, and their ratio, from the view where that is largest."""
    pairs = (_PAIRS[name](scenes, backend, direction) for direction in DIRECTIONS)
    return max(
        (paired_ms(*pair, scenes.repeats, time.process_time) for pair in pairs), key=lambda t: t[2]
    )


Pair = tuple[Callable[[], Any], Callable[[], Any]]


def _tinted(scenes: Scenes, backend: str, direction: tuple[float, float, float]) -> Pair:
    import napari_unpack as nu
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering import cast_tinted

    packing, view = scenes.packing, View(direction)
    camera = view.camera(packing.volume.shape, MM)
    look, bricks = scenes.transfer_function, scenes.bricks
    white = np.ones((packing.count + 1, 4), np.float32)
    ours = partial(_fresh, scenes, partial(
        nu.render, view=view, transfer_function=look, size=scenes.canvas, backend=backend,
    ))  # fmt: skip

    def cast(volume: Any, labels: Any) -> Any:
        return cast_tinted(
            volume, labels, MM, camera, look, white, scenes.canvas,
            shading=SHADING, bricks=bricks, backend=backend,
        )  # fmt: skip

    return ours, partial(_fresh, scenes, cast)


def _ids(scenes: Scenes, backend: str, direction: tuple[float, float, float]) -> Pair:
    import napari_unpack as nu
    from napari_unpack.rendering import cast_ids

    # Two layers, as many as the public function peels.
    cast = partial(cast_ids, layers=2)
    return _counting(scenes, backend, direction, nu.object_id_layers, cast)


def _occlusion(scenes: Scenes, backend: str, direction: tuple[float, float, float]) -> Pair:
    import napari_unpack as nu
    from napari_unpack.rendering import cast_occlusion

    return _counting(scenes, backend, direction, nu.occlusion_ratios, cast_occlusion)


def _counting(
    scenes: Scenes,
    backend: str,
    direction: tuple[float, float, float],
    public: Callable[..., Any],
    inner: Callable[..., Any],
) -> Pair:
    """Return a public function of labels and its inner cast, the making of bricks included."""
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering.cpu import Bricks

    view = View(direction)
    camera = view.camera(scenes.packing.volume.shape, MM)
    shown = np.arange(scenes.packing.count + 1) > 0
    size = (scenes.edge(512), scenes.edge(512))

    def ours(_: Any, labels: Any) -> Any:
        return public(labels, view=view, size=size, backend=backend)

    def cast(_: Any, labels: Any) -> Any:
        bricks = Bricks.of(labels)
        return inner(labels, MM, camera, shown, size, bricks=bricks, backend=backend)

    return partial(_fresh, scenes, ours), partial(_fresh, scenes, cast)


_PAIRS = {"render": _tinted, "object_id_layers": _ids, "occlusion_ratios": _occlusion}


def _fresh(scenes: Scenes, work: Callable[[Any, Any], Any]) -> Any:
    """Do a work on arrays that nothing has been kept of."""
    return work(scenes.packing.volume[:], scenes.packing.labels[:])
