"""One web page on which somebody without napari turns the bag, unpacks it and asks for names.

The page is a single file that fetches nothing. `interactive_page.js` draws on it with WebGL 2.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import check_writable, checked_target, written_atomically
from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.easing import ease
from napari_unpack.geometry.view import Camera
from napari_unpack.io.headless import packed_copy, packed_count
from napari_unpack.io.images import straight_bytes
from napari_unpack.io.report import said_of_objects, volume_unit_of
from napari_unpack.io.simplified_surfaces import simplified
from napari_unpack.io.surfaces import object_surface
from napari_unpack.io.table_page import SCRIPT, PageColumn, PageParts, number_cell, table_page
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.cpu import CANCELLING
from napari_unpack.rendering.scene import LIGHT
from napari_unpack.session.framing import fitted, height_with
from napari_unpack.session.placement import launch
from napari_unpack.tasks import Progress, Share, no_progress, relayed

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.session.state import Group

WINDOW = (720, 960)
"""Height and width of the view, CSS pixels; the page keeps its layout in views of other shapes."""

GEOMETRY_BYTES = 12_000_000
"""Of all surfaces, as they stand in the page; with pictures and table 40 objects take 15 MB."""

# Of a path. Between two the page goes straight: no object is more than a pixel off its way.
SAMPLES = 41

# Indices of points and coordinates take two bytes each. Of indices the last is WebGL 2's sign for
# the end of a strip, which is no point.
MOST_POINTS = 2**16 - 1
GRID = 2**16 - 1

# Base64 writes three bytes as four letters.
LETTERS_PER_BYTE = 4 / 3
BYTES_PER_CORNER = 6

# From pivot space (towards, down, right) to WebGL's axes (right, up, towards): no mirror.
GL_FROM_PIVOT = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

COLUMNS = (
    PageColumn("Name", "t", "part"),
    PageColumn("ID", "n", "whole"),
    PageColumn("Order out", "n"),
    PageColumn("Volume {volume}", "n"),
)
SAID = {"flag": "", "note": "long"}
"""Columns of what a person said of objects, where one did of any, and the style of each."""


@dataclass(frozen=True, eq=False)
class _Surface:
    """A surface about the middle of its object's box, mm, along (stretched) world axes."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    error: float

    @property
    def letters(self) -> float:
        return BYTES_PER_CORNER * (len(self.points) + len(self.triangles)) * LETTERS_PER_BYTE

    @property
    def told(self) -> float:
        """How far it may be from the surface that it was, with the rounding to the grid, mm."""
        size = np.ptp(self.points, axis=0)
        return self.error + float(np.linalg.norm(size)) / GRID / 2

    def coarser(self, cell: float) -> _Surface:
        points, triangles, error = simplified(self.points, self.triangles, cell)
        # Errors of one step after the other add up at most.
        return _Surface(points, triangles, self.error + error)


def save_interactive_page(
    session: Session,
    path: str | Path,
    title: str = "Packed bag",
    progress: Progress | None = None,
    backend: str = "auto",
) -> Path:
    """Write one HTML file on which the bag turns and its objects leave and return.

    What was unpacked leaves first, in the order in which it did, then what is next. Hidden
    objects are left out. Surfaces are simplified to `GEOMETRY_BYTES`; the page says how far they
    are from those that `save_surfaces` writes.

    Parameters
    ----------
    session : Session
        Its view, colours, names and order. Not changed: a copy is unpacked, so this may run on
        any thread.
    path : str or Path
        .html; its folder must exist.
    title : str
        What the page is called.
    progress : callable, optional
        Takes (fraction, text); raising in it cancels and leaves no file.
    backend : {"auto", "cpu", "gl"}
        Of the pictures that a browser without WebGL 2 shows.

    Raises
    ------
    ValueError
        If the file is to be no .html, or all objects are hidden.
    """
    target = checked_target(path, ".html", ".htm")
    check_writable(target)
    share = Share(progress or no_progress)
    shown = packed_copy(session)
    shown.canvas_size = WINDOW
    if not packed_count(shown):
        raise ValueError("there is nothing to show: all objects are hidden")
    _unpack_all(shown, share.part(0.0, 0.2, "Finding the order"))
    camera = replace(fitted(shown), height=shown.slots.height_mm)
    heights = _heights(shown)
    surfaces = _surfaces(shown, share.part(0.2, 0.8, "Finding surfaces"))
    stills = _stills(shown, camera, heights, share.part(0.8, 1.0, "Drawing pictures"), backend)
    page = _page(
        title, session, shown, surfaces, _data(session, shown, camera, heights, surfaces), stills
    )
    with written_atomically(target) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
    share(1.0, "Written")
    return target


def _unpack_all(shown: Session, share: Share) -> None:
    count, gone = packed_count(shown), 0
    while gone < count:
        # How many leave together is known once they have.
        with CANCELLING.by(share.part(gone / count, gone / count)):
            if not shown.go_to(shown.step + 1):
                return
        gone = count - packed_count(shown)


def _heights(shown: Session) -> list[float]:
    """Return the camera's heights with 0, 1, 2... steps done: what is out is in view."""
    packed = packed_copy(shown)
    packed.canvas_size = WINDOW
    heights = [fitted(packed).height]
    for group in shown.steps:
        heights.append(max(heights[-1], height_with(shown, group)))
    return heights


def _surfaces(shown: Session, share: Share) -> dict[int, _Surface]:
    ids = [i for group in shown.steps for i in group]
    cell, found = float(shown.spacing.min()), {}
    for k, i in enumerate(ids):
        text = f"Finding surfaces: {k} of {len(ids)}"
        part = share.part(k / len(ids), (k + 1) / len(ids), text)
        one = relayed(partial(_surface, shown, i), part).coarser(cell)
        own = cell
        while len(one.points) > MOST_POINTS:
            one = one.coarser(own := 1.5 * own)
        found[i] = one
    while (letters := sum(one.letters for one in found.values())) > GEOMETRY_BYTES:
        # The number of points goes with the inverse square of the cell; a little more, as what
        # was joined once joins less.
        cell *= max(1.2, 1.05 * (letters / GEOMETRY_BYTES) ** 0.5)
        found = {i: one.coarser(cell) for i, one in found.items()}
    return found


def _surface(shown: Session, object_id: int, progress: Progress) -> _Surface:
    window = shown.boxes.slices(object_id)
    voxels, triangles = object_surface(shown.labels[window] == object_id, progress)
    first = [one.start for one in window]
    middle = shown.boxes.center(object_id, shown.spacing)
    points = ((voxels + first) * shown.spacing - middle) @ shown.camera.stretch.T
    return _Surface(points, triangles, 0.0)


def _data(
    session: Session,
    shown: Session,
    camera: Camera,
    heights: list[float],
    surfaces: dict[int, _Surface],
) -> dict[str, Any]:
    """Return what the script is told, in WebGL's axes."""
    names, step = shown.objects["name"], session.step
    # Groups that a person took out and hid are no steps here.
    done = sum(any(i in session.state.placements for i in group) for group in shown.steps[:step])
    objects: list[dict[str, Any]] = []
    for k, group in enumerate(shown.steps, 1):
        paths = _paths(shown, camera, group)
        for i in group:
            color = np.clip(shown.solo_tints(i)[i, :3], 0, 1)
            # As text: a browser's numbers are floats, of which IDs above 2**53 would share one.
            about = {"id": str(shown.label_of(i)), "name": str(names[i]), "step": k}
            shape = {**_encoded(surfaces[i]), "color": _short(color), "path": _short(paths[i])}
            objects.append(about | shape)
    return {
        "fov": camera.fov,
        "window": WINDOW,
        "heights": _short(heights),
        "seconds": session.seconds,
        "step": done,
        "steps": len(shown.steps),
        "light": [LIGHT.ambient, LIGHT.diffuse, LIGHT.specular, LIGHT.shininess],
        "objects": objects,
    }


def _paths(shown: Session, camera: Camera, group: Group) -> dict[int, NDArray[np.float64]]:
    """Return the way out of each of a group, (SAMPLES, 9) by ID.

    Centre (3), size, turn as a quaternion x y z w (4), and how far it has left the bag's axes
    for the window's: 0 turns with the bag, 1 stands still.
    """
    from scipy.spatial.transform import Rotation

    placements = {i: shown.state.placements[i] for i in group}
    flights = launch(shown.bag, placements, shown.slots, camera.stretch, 0.0, 1.0, False)
    paths = {}
    for i, flight in flights.items():
        way, rows = flight.legs(camera), []
        for fraction in np.linspace(0, 1, SAMPLES):
            pose = way.pose_at(float(fraction))
            turn = Rotation.from_matrix(_in_gl(pose.rotation)).as_quat(canonical=True)
            left = ease((float(fraction) - way.first) / (1 - way.first))
            rows.append([*(GL_FROM_PIVOT @ pose.center), pose.scale, *turn, left])
        paths[i] = np.array(rows)
    return paths


def _in_gl(rotation: Matrix) -> Matrix:
    turned: Matrix = GL_FROM_PIVOT @ rotation @ GL_FROM_PIVOT.T
    return turned


def _encoded(surface: _Surface) -> dict[str, Any]:
    points = surface.points @ GL_FROM_PIVOT.T
    low = points.min(axis=0)
    # A surface has some extent along each axis.
    step = (points.max(axis=0) - low) / GRID
    grid = np.rint((points - low) / step).astype("<u2")
    a, b, c = (points[surface.triangles[:, k]] for k in range(3))
    triangles = surface.triangles
    # Of a mirrored bag the outside would be inside.
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        triangles = triangles[:, ::-1]
    return {
        "low": low.tolist(),
        "grid": step.tolist(),
        "points": _base64(grid.tobytes()),
        "triangles": _base64(triangles.astype("<u2").tobytes()),
    }


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _short(numbers: Any) -> list[float]:
    return [float(f"{v:.6g}") for v in np.ravel(numbers)]


def _stills(
    shown: Session, camera: Camera, heights: list[float], share: Share, backend: str
) -> list[tuple[str, str]]:
    """Return pictures of three steps as data URIs, and what each shows."""
    import imageio.v3 as iio

    last, made, poses = len(shown.steps), [], shown.poses
    scene = shown.scene()
    steps = sorted({0, (last + 1) // 2, last})
    for k, step in enumerate(steps):
        out = {i for group in shown.steps[:step] for i in group}
        packed = frozenset(poses.keys() - out)
        there = {i: pose for i, pose in poses.items() if i in out}
        now = replace(scene, packed=packed, poses=there)
        with CANCELLING.by(share.part(k / len(steps), (k + 1) / len(steps))):
            image = scene_image(now, replace(camera, height=heights[step]), WINDOW, None, backend)
        # Two thirds of a PNG's bytes and more; browsers with no WebGL 2 know it as well.
        data = iio.imwrite("<bytes>", straight_bytes(image), extension=".webp", quality=85)
        words = "Everything is packed." if not step else f"Step {step} of {last}."
        made.append((f"data:image/webp;base64,{_base64(data)}", words))
    return made


def _page(
    title: str,
    session: Session,
    shown: Session,
    surfaces: dict[int, _Surface],
    data: dict[str, Any],
    stills: list[tuple[str, str]],
) -> str:
    script = files(__package__).joinpath("interactive_page.js").read_text("utf-8")
    style = files(__package__).joinpath("interactive_page.css").read_text("utf-8")
    hashes = " ".join(
        f"'sha256-{_base64(hashlib.sha256(s.encode()).digest())}'" for s in (script, SCRIPT)
    )
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {hashes}"
    # Within a script's text no end tag and no comment may stand, whatever a name says.
    told = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    error = _rounded_up(max(one.told for one in surfaces.values()), session)
    hidden = len(session.state.hidden)
    pictures = "\n".join(
        f'<figure><img src="{uri}" alt="{words}" width="{WINDOW[1]}" height="{WINDOW[0]}">'
        f"<figcaption>{words}</figcaption></figure>"
        for uri, words in stills
    )
    lead = f"{len(surfaces)} objects"
    left_out = f" Hidden objects are left out: {hidden}." if hidden else ""
    parts = PageParts(
        title,
        lead,
        "name, note, flag or ID",
        _VIEW.format(pictures=pictures, last=len(shown.steps)),
        f'<p class="made">Surfaces are simplified by at most {error}.'
        f'{left_out}</p>\n<script type="application/json" id="bag">{told}</script>\n'
        f"<script>{script}</script>\n",
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n',
        style,
    )
    volume = volume_unit_of(session).name
    columns = [replace(one, title=one.title.format(volume=volume)) for one in COLUMNS]
    objects = said_of_objects(shown).loc[[*surfaces]]
    said = [key for key in SAID if key in objects and any(objects[key])]
    columns += [PageColumn(key.capitalize(), "t", "part") for key in said]
    return table_page(parts, columns, _rows(session, shown, said))


def _rounded_up(mm: float, session: Session) -> str:
    """Return a length in the session's unit, two digits of it: rounded down it would be a lie."""
    unit = session.length_unit
    digit = 10.0 ** (math.floor(math.log10(mm * unit.per_mm)) - 1)
    return f"{unit.edges([math.ceil(mm * unit.per_mm / digit) * digit / unit.per_mm])} {unit.name}"


_VIEW = """<section id="view" aria-label="The bag">
<div id="stills">
<p>This browser does not show WebGL 2, so the bag cannot be turned. Here are pictures of it.</p>
{pictures}
</div>
<div id="live" hidden>
<canvas tabindex="0" role="application" aria-label="The bag. Arrow keys turn it, plus and minus \
come near and draw back, N unpacks the next, B puts the last back, 0 shows all."></canvas>
<div class="bar">
<button id="back">Put back</button>
<input id="step" type="range" min="0" max="{last}" step="1" autocomplete="off" \
aria-label="Step of the unpacking">
<button id="next">Unpack next</button>
<button id="whole">Show all</button>
</div>
<p id="said" role="status"></p>
<p>Drag to turn, wheel or pinch to come near, click for a name.</p>
</div>
</section>
"""


def _rows(session: Session, shown: Session, said: list[str]) -> Iterator[str]:
    objects, volumes = said_of_objects(session), volume_unit_of(session)
    for k, group in enumerate(shown.steps, 1):
        for i in group:
            facts = objects.loc[i]
            # Names, flags and notes come from users and files.
            name = escape(str(facts["name"]))
            told = [f'<td class="{SAID[key]}">{escape(str(facts[key]))}</td>' for key in said]
            red, green, blue = (round(255 * float(v)) for v in shown.solo_tints(i)[i, :3])
            swatch = f'<i style="background:rgb({red},{green},{blue})"></i>'
            label = shown.label_of(i)
            yield (
                f'<tr data-id="{label}"><td class="name"><button aria-pressed="false">{swatch}'
                f"<span>{name}</span></button></td>"
                + number_cell(label, str(label))
                + number_cell(k, str(k))
                + number_cell(facts["volume_mm3"], volumes.text(float(facts["volume_mm3"])))
                + "".join(told)
                + "</tr>"
            )
