"""The bag's box and a scale bar: drawn into images, with depths where they have some."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance.background import Background, Color
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit
from napari_unpack.geometry.view import Camera
from napari_unpack.kernels import njit

if TYPE_CHECKING:
    from PIL import ImageDraw
    from PIL.ImageFont import FreeTypeFont

KINDS = ("box", "scale")
# Pairs of the corners that `geometry.boxes.box_corners` lists.
EDGES = (
    (0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7),
)  # fmt: skip

# Width of the box's edges, pixels of an image 720 pixels high.
LINE = 1.3


@dataclass(frozen=True, eq=False)
class Decorations:
    """What an image shows besides the bag.

    Parameters
    ----------
    background : Background
        Behind everything.
    box : bool
        Edges of the box around all objects.
    scale : bool
        A scale bar, true in the plane of the camera's centre.
    unit : LengthUnit
        Of the scale bar, and of all lengths and volumes that are told.
    measurements : bool
        Lengths and angles that a person measured.
    """

    background: Background
    box: bool = False
    scale: bool = False
    unit: LengthUnit = MM
    measurements: bool = True

    @classmethod
    def of(cls, background: object = "dark", decorations: Iterable[str] = ()) -> Decorations:
        """Make decorations of a background and names.

        Parameters
        ----------
        background : object
            See `Background.of`.
        decorations : iterable of {"box", "scale"}

        Raises
        ------
        ValueError
            If either is none that there is.
        """
        names = [decorations] if isinstance(decorations, str) else list(decorations)
        unknown = [name for name in names if name not in KINDS]
        if unknown:
            raise ValueError(f"decorations must be out of {', '.join(KINDS)}, got {unknown[0]!r}")
        return cls(Background.of(background), "box" in names, "scale" in names)

    @property
    def ink(self) -> Color:
        """Straight RGBA of lines and writing that read well on the background."""
        return (0.1, 0.11, 0.13, 0.75) if self.background.is_light else (0.93, 0.95, 1.0, 0.7)


def box_edges(
    lower: NDArray[np.float64], upper: NDArray[np.float64], camera: Camera
) -> NDArray[np.float64]:
    """Return the (12, 2, 3) edges of a box in the camera's pivot space.

    Parameters
    ----------
    lower, upper : (3,) ndarray of float64
        Its corners, world mm.
    camera : Camera
        Whose pivot space it is.
    """
    corners = transform_points(camera.pivot_from_world(), box_corners(lower, upper))
    return corners[np.array(EDGES)]


def draw_edges(
    edges: NDArray[np.float64], camera: Camera, size: tuple[int, int], ink: Color
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draw straight edges, smooth at any angle.

    Parameters
    ----------
    edges : (N, 2, 3) ndarray of float64
        Ends in pivot space, mm.
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.
    ink : (r, g, b, a)
        Straight.

    Returns
    -------
    rgba : (H, W, 4) ndarray of float32
        Premultiplied.
    depth : (H, W) ndarray of float32
        t in mm on every pixel that an edge touches, +inf elsewhere.

    Notes
    -----
    Edges that reach behind the eye are left out. Along an edge 1 / (distance + t) is linear in
    the image.
    """
    alpha, depth = np.zeros(size, np.float32), np.full(size, np.inf, np.float32)
    # Thinner than 0.8 pixels a line breaks up on small images.
    half = max(LINE * min(size) / 720, 0.8) / 2
    for ends in edges:
        # An end behind the eye projects to the other side of the image.
        if camera.behind_eye(ends):
            continue
        t = -ends[:, 0]
        linear = t if np.isinf(camera.distance) else 1 / (camera.distance + t)
        line = np.column_stack([camera.pixels(ends, size), linear])
        _draw(alpha, depth, line, half, camera.distance)
    color = np.array([*ink[:3], 1.0], np.float32) * np.float32(ink[3])
    return alpha[..., None] * color, depth


def stroke_cover(
    lines: Iterable[NDArray[np.float64]], size: tuple[int, int], half: float
) -> NDArray[np.float32]:
    """Return how much of each pixel lines cover, (H, W) float32.

    Parameters
    ----------
    lines : iterable of (N, 2) ndarray of float64
        Row and column of the ends of their pieces.
    size : (int, int)
        Height and width of the image, pixels.
    half : float
        Half of their width, pixels.
    """
    cover, depth = np.zeros(size, np.float32), np.full(size, np.inf, np.float32)
    for line in lines:
        for ends in pairwise(line):
            _draw(cover, depth, np.insert(ends, 2, 0.0, axis=1), half, np.inf)
    return cover


def _draw(
    alpha: NDArray[np.float32],
    depth: NDArray[np.float32],
    line: NDArray[np.float64],
    half: float,
    distance: float,
) -> None:
    # So far outside no pixel of the image is touched.
    near = _cut_line(line, alpha.shape, half + 1)
    if near is not None:
        (r0, c0, u0), (r1, c1, u1) = near
        _stroke(alpha, depth, r0, c0, u0, r1, c1, u1, half, distance)


def _cut_line(
    line: NDArray[np.float64], size: tuple[int, ...], margin: float
) -> NDArray[np.float64] | None:
    """Return the part of a straight line that lies in the image; None where none does.

    Parameters
    ----------
    line : (2, N) ndarray of float64
        Row and column of its ends, pixels, and what else is linear in the image.
    size : (int, int)
        Height and width of the image, pixels.
    margin : float
        Pixels around the image that count as in it.
    """
    cut = line.copy()
    for axis, count in enumerate(size):
        for side, bound in ((-1, -margin), (1, count - 1 + margin)):
            outside = side * (cut[:, axis] - bound) > 0
            if outside.all():
                return None
            if outside.any():
                (out,), (within,) = cut[outside], cut[~outside]
                share = (bound - within[axis]) / (out[axis] - within[axis])
                end = within + share * (out - within)
                # Exactly, however far the end was and however it was rounded.
                end[axis] = bound
                cut[outside] = end
    return cut


def scale_mark(
    camera: Camera, size: tuple[int, int], ink: Color, unit: LengthUnit
) -> tuple[NDArray[np.float32], int, int]:
    """Draw a scale bar and its length.

    Parameters
    ----------
    camera, size, ink
        As for `draw_edges`.
    unit : LengthUnit

    Returns
    -------
    rgba : (h, w, 4) ndarray of float32
        The image's lower right corner, premultiplied.
    row, col : int
        Its first pixel.
    """
    from PIL import Image, ImageDraw, ImageFont

    # A fifth of the width is long enough to be read off, and leaves room for the bag.
    length, words = round_length(0.2 * camera.height * size[1] / size[0], unit)
    pixels = max(1, round(length * size[0] / camera.height))
    # Sizes are those of an image 720 pixels high; below half of that writing is illegible.
    zoom = max(min(size) / 720, 0.5)
    thick, edge = max(1, round(3 * zoom)), round(24 * zoom)
    # Room for words that are longer than the bar.
    height, width = min(size[0], round(90 * zoom)), min(size[1], pixels + 6 * edge)
    canvas = Image.new("L", (width, height))
    pen = ImageDraw.Draw(canvas)
    right, bottom = width - edge, height - edge
    pen.rectangle((right - pixels, bottom - thick, right - 1, bottom - 1), fill=255)
    font = ImageFont.load_default(size=max(12, round(15 * zoom)))
    assert isinstance(font, ImageFont.FreeTypeFont), "a size was asked for"
    # Beside a short bar the words end where the bar ends, or the edge would cut them off.
    middle = min(right - pixels / 2, right + edge - 4 - font.getlength(words) / 2)
    write(pen, middle, bottom - thick - round(6 * zoom), words, font)
    alpha = np.asarray(canvas, np.float32)[..., None] / np.float32(255)
    color = np.array([*ink[:3], 1.0], np.float32) * np.float32(min(1.0, ink[3] + 0.2))
    drawn: NDArray[np.float32] = alpha * color
    return drawn, size[0] - height, size[1] - width


def write(
    pen: ImageDraw.ImageDraw,
    middle: float,
    baseline: float,
    words: str,
    font: FreeTypeFont,
    rim: int = 0,
) -> None:
    """Write words into a mask.

    Parameters
    ----------
    pen : ImageDraw
    middle, baseline : float
        Column and row.
    words : str
    font : FreeTypeFont
        Pillow's own.
    rim : int
        So many pixels thicker on all sides.
    """
    # Pillow's own font has no µ: it is written as a u with a longer stem.
    plain = words.replace("\N{MICRO SIGN}", "u")
    pen.text((middle, baseline), plain, fill=255, font=font, anchor="ms", stroke_width=rim)
    if MICRO in words:
        start = middle - font.getlength(plain) / 2 + font.getlength(plain[: words.index(MICRO)])
        left = round(start + font.getbbox("u", anchor="ls")[0])
        stem, below = max(1, round(font.size / 11)), round(font.size / 5)
        corners = (left, baseline - below, left + stem - 1, baseline + below)
        pen.rectangle(
            tuple(v + way * rim for v, way in zip(corners, (-1, -1, 1, 1), strict=True)), fill=255
        )


def round_length(longest: float, unit: LengthUnit = MM) -> tuple[float, str]:
    """Return the largest of 1, 2 and 5 times a power of ten up to a length, mm, and its words.

    Parameters
    ----------
    longest : float
        mm.
    unit : LengthUnit
        In which the length is round.
    """
    limit = longest * unit.per_mm
    power = 10.0 ** np.floor(np.log10(limit))
    length = float(power * max(f for f in (1, 2, 5) if f * power <= limit * (1 + 1e-9)))
    # In steps of a thousand, for the unit that says it with the fewest digits.
    steps = {"mm": (MICRO, "mm", "m"), MICRO: ("nm", MICRO, "mm")}.get(unit.name, (unit.name,) * 3)
    shift = 0 if unit.name == "voxels" else 1 if length >= 1000 else 0 if length >= 1 else -1
    return length / unit.per_mm, f"{length / 1000.0**shift:g} {steps[1 + shift]}"


@njit(cache=True, nogil=True)
def _stroke(alpha, depth, r0, c0, u0, r1, c1, u1, half, distance):  # type: ignore[no-untyped-def]
    height, width = alpha.shape
    dr, dc = r1 - r0, c1 - c0
    length = np.sqrt(dr * dr + dc * dc)
    if length < 1e-6:
        return
    # Step along the longer axis, so that no pixel of the line is passed over.
    steep = abs(dr) >= abs(dc)
    a0, b0, da, db = (r0, c0, dr, dc) if steep else (c0, r0, dc, dr)
    most_a, most_b = (height, width) if steep else (width, height)
    lean = length / abs(da)
    reach = (half + 1) * lean
    first = max(0, int(np.floor(min(a0, a0 + da) - half)))
    last = min(most_a - 1, int(np.ceil(max(a0, a0 + da) + half)))
    for a in range(first, last + 1):
        s = min(max((a - a0) / da, 0.0), 1.0)
        b = b0 + s * db
        for k in range(max(0, int(np.floor(b - reach))), min(most_b, int(np.ceil(b + reach)) + 1)):
            row, col = (a, k) if steep else (k, a)
            along = ((row - r0) * dr + (col - c0) * dc) / (length * length)
            along = min(max(along, 0.0), 1.0)
            off = np.hypot(row - r0 - along * dr, col - c0 - along * dc)
            # Coverage of the pixel by a line of this width, taken as a box one pixel wide.
            cover = min(max(half + 0.5 - off, 0.0), min(1.0, 2 * half))
            if cover > alpha[row, col]:
                alpha[row, col] = cover
                # Linear in the image: t without perspective, else 1 / (distance + t).
                u = u0 + along * (u1 - u0)
                depth[row, col] = u if distance == np.inf else 1 / u - distance
