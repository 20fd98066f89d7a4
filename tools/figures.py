"""The paper's figures with our own eyes: film strip, layers apart, inspection, reveal.

Headless, from any session; `screenshots.py` calls `draw` for its bags. Panels are separated by
a thin dark line and bear no text.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.geometry.view import View
from napari_unpack.io import save_png
from napari_unpack.rendering.compose import object_image, packed_image, scene_image, sprite_image
from napari_unpack.rendering.image_patch import compose

PANEL = (640, 820)
FILM = (440, 740)
LINE = 4
EDGE = 24
LOOKING = (0.45, 0.75, 0.35)
BACK = (0.055, 0.063, 0.078)

Image = NDArray[np.float32]
Direction = tuple[float, float, float]


def draw(session: Any, gallery: Path, name: str, looking: Direction = LOOKING) -> None:
    """Draw all figures of a session, which is packed before and after.

    Parameters
    ----------
    session : Session
    gallery : Path
        Folder.
    name : str
        First word of the files.
    looking : (float, float, float)
        Direction of looking, z y x.
    """
    session.canvas_size = PANEL
    session.view = View(looking, fov=18.0)
    session.look(session.overview())
    session.recolor()
    for number, figure in (
        ("figure-1", strip),
        ("figure-4", layers),
        ("figure-5", studied),
        ("reveal", revealed),
    ):
        save_png(figure(session), gallery / f"{name}-{number}.png")
        while session.undo():
            pass
        session.animated = False


def film(path: Path) -> None:
    """Film how ten of 24 objects leave, small enough for the first page of a project."""
    from napari_unpack import movie

    session = _bag()
    session.canvas_size = FILM
    session.view = View(LOOKING, fov=18.0)
    session.look(session.overview())
    session.recolor()
    movie(session, path, 10, FILM, fps=15, seconds=0.7, backend="cpu")


def _bag() -> Any:
    from napari_unpack import Session, simulate_bag

    bag = simulate_bag(seed=3, shape=(170, 150, 210), count=24)
    return Session(bag.volume, bag.labels, bag.spacing, bag.objects)


def strip(session: Any) -> Image:
    """Return the film strip of Figure 1: packed, one in the air, and ever emptier."""
    pictures = [_scene(session)]
    pictures.append(_flight(session))
    for count in (3, 4, 5, 6):
        session.unpack(count)
        pictures.append(_scene(session))
    return _grid(pictures, 3)


def layers(session: Any) -> Image:
    """Return Figure 4: the three layers apart, and together."""
    session.unpack(6)
    flying, now = _in_the_air(session)
    camera, size = session.camera, PANEL
    packed = [packed_image(session.scene(), camera, size)]
    air = [
        object_image(session.scene(), i, flight.pose(now, camera), camera, size)
        for i, flight in session.flights.items()
        if i in flying
    ]
    beside = []
    for i, pose in session.poses.items():
        nearness = 1.0 - pose.center[0] / camera.distance
        patch = sprite_image(session.scene(), i, pose, size[0] / camera.height / nearness)
        row, col = np.rint(camera.pixels(pose.center, size)).astype(int)
        beside.append(patch.at(patch.row + int(row), patch.col + int(col), patch.plane))
    apart = [compose(size, part, BACK) for part in (packed, air, beside)]
    together = scene_image(session.scene(), camera, size, now)
    _land(session)
    return _grid([*apart, together], 2)


def studied(session: Any) -> Image:
    """Return Figure 5: a sprite, its object studied and turned, and the sprite it becomes."""
    session.unpack(12)
    largest = max(session.poses, key=lambda i: _interest(session, i))
    before = _scene(session)
    session.inspect(largest)
    pose = session.poses[largest]
    turn = rotation_about((0.0, 1.0, 0.0), 0.9) @ rotation_about((0.0, 0.0, 1.0), -0.6)
    turned = replace(pose, rotation=turn @ pose.rotation)
    session.place(largest, turned)
    alone = _scene(session)
    session.leave()
    return _grid([before, alone, _scene(session)], 3)


def revealed(session: Any) -> Image:
    """Return a buried object shown through what must leave for it, and the bag after that."""
    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.viewer.overlays import LEAVING_FIRST, draw_outlines

    target, found = _buried(session)
    frame = Frame(session.camera, PANEL, np.eye(4))
    inks = dict.fromkeys(found.first, LEAVING_FIRST)
    picture = _scene(session)
    shot = draw_outlines(session.scene(), session.ray_queries, inks, target, frame)
    if shot is not None:
        patch = shot.patch
        rows = slice(patch.row, patch.row + patch.size[0])
        cols = slice(patch.col, patch.col + patch.size[1])
        under = picture[rows, cols]
        under[:] = patch.rgba + (1.0 - patch.rgba[..., 3:]) * under
    session.reveal(target, tuple(found.direction))
    return _grid([picture, _scene(session)], 2)


def _buried(session: Any) -> tuple[int, Any]:
    """Return an object for which a handful must leave, the largest of them."""
    voxels = session.objects["voxels"]
    answer = session.queries.occlusion()
    buried = []
    for object_id in sorted(session.ids, key=lambda i: -voxels[i]):
        if answer.blocking.blockers([object_id]):
            buried.append((object_id, session.reveal_plan(object_id)))
            if 3 <= len(buried[-1][1].first) <= 6:
                return buried[-1]
    return min(buried, key=lambda one: abs(len(one[1].first) - 4))


def _interest(session: Any, object_id: int) -> float:
    """Return how much there is to see of an object: large, solid to the eye, and no plain box."""
    box = np.prod(np.ptp(session.boxes.corners(object_id, session.spacing), axis=0))
    volume = session.objects.loc[object_id, "volume_mm3"]
    inside = session.labels[session.boxes.slices(object_id)] == object_id
    densities = session.volume[session.boxes.slices(object_id)][inside]
    opacity = session.transfer_function.opacity_at(densities).mean()
    return float(volume**0.5 * (1.0 - volume / box) * opacity)


def _flight(session: Any) -> Image:
    _, now = _in_the_air(session)
    picture = scene_image(session.scene(), session.camera, PANEL, now)
    _land(session)
    return picture


def _in_the_air(session: Any) -> tuple[frozenset[int], float]:
    """Send the next object out; return who flies, and the moment when it has come half way."""
    session.animated = True
    session.unpack(1)
    session.look(session.overview())
    flights = session.flights
    start = max(flight.start for flight in flights.values())
    return frozenset(flights), start + 0.55 * session.seconds


def _land(session: Any) -> None:
    for object_id in list(session.flights):
        session.land(object_id)
    session.animated = False


def _scene(session: Any) -> Image:
    # As far back as what is out needs, as the plugin's camera stands.
    session.look(session.overview())
    return np.array(scene_image(session.scene(), session.camera, PANEL))


def _trimmed(pictures: list[Image]) -> list[Image]:
    """Take away the rows above and below that are empty in all pictures."""
    drawn = np.any([np.abs(p[..., :3] - BACK).max(axis=2) > 0.03 for p in pictures], axis=(0, 2))
    rows = np.flatnonzero(drawn)
    low, high = max(rows[0] - EDGE, 0), min(rows[-1] + EDGE + 1, len(drawn))
    return [picture[low:high] for picture in pictures]


def _grid(pictures: list[Image], columns: int) -> Image:
    """Lay pictures side by side with a line between them, (H, W, 4)."""
    pictures = _trimmed(pictures)
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    whole = np.zeros((rows * (height + LINE) - LINE, columns * (width + LINE) - LINE, 4))
    whole[..., :3], whole[..., 3] = 0.16, 1.0
    for k, picture in enumerate(pictures):
        top, left = (k // columns) * (height + LINE), (k % columns) * (width + LINE)
        whole[top : top + height, left : left + width] = picture
    return whole.astype(np.float32)


def main(gallery: Path, source: Path | None = None) -> None:
    """Draw the figures of a simulated bag, or of a scan that is segmented first."""
    from napari_unpack.io import load_volume
    from napari_unpack.io.headless import open_scan

    if source is not None:
        session = open_scan(load_volume(source), LOOKING, backend="cpu")
        draw(session, gallery, source.stem)
        return

    gallery.mkdir(parents=True, exist_ok=True)
    draw(_bag(), gallery, "bag")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(Path, sys.argv[2:]))
