"""What a tinted frame and an ID picture cost as the volume and the objects grow."""

from __future__ import annotations

import numpy as np

from benchmarks.packing import Packing, pack
from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, SHADING, Scenes
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_ids, cast_tinted
from napari_unpack.rendering.cpu import Bricks

SHAPES = ((128, 128, 128), (256, 256, 256), (256, 256, 512), (512, 512, 1024))
CELLS = ((1, 2, 5), (5, 5, 8), (10, 10, 20), (30, 40, 50))
WORK = "512x512 rays, CPU: tinted frame; two ID layers; bricks, once a volume; after hiding one"


def measure(scenes: Scenes) -> list[Row]:
    rows = [_row("cost, volume size", scenes, pack(scenes.shape(*s), (3, 3, 3))) for s in SHAPES]
    for cells in CELLS:
        rows.append(_row("cost, objects", scenes, pack(scenes.shape(256, 256, 512), cells)))
    return rows


def _row(what: str, scenes: Scenes, packing: Packing) -> Row:
    volume, labels, count = packing.volume, packing.labels, packing.count
    camera = View((0.5, 0.35, 1.0)).camera(volume.shape, MM)
    size = scenes.edge(512), scenes.edge(512)
    tints = np.ones((count + 1, 4), np.float32)
    tints[0] = 0
    visible = tints[:, 3] > 0
    bricks = Bricks.of(labels, volume)
    look = scenes.transfer_function

    def frame() -> object:
        return cast_tinted(
            volume, labels, MM, camera, look, tints, size,
            shading=SHADING, bricks=bricks, backend="cpu",
        )  # fmt: skip

    def ids() -> object:
        return cast_ids(labels, MM, camera, visible, size, 2, bricks=bricks, backend="cpu")

    def hidden() -> object:
        tints[1] = 0
        return bricks.occupied(look.table(1024), look.domain, tints)

    looking = best_ms(lambda: Bricks.of(labels, volume), 1)
    took = best_ms(frame, scenes.repeats), best_ms(ids, scenes.repeats), looking
    hiding = best_ms(hidden, scenes.repeats)
    size_of = "x".join(map(str, volume.shape))
    return Row(
        what,
        f"{size_of}, {count} objects; {WORK}",
        ", ".join(ms(t) for t in (*took, hiding)),
        goal="printed",
    )
