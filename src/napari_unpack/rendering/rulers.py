"""Measurements in pictures: their lines, an angle's arc, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance.decorations import stroke_cover, write
from napari_unpack.geometry.transforms import Projection
from napari_unpack.rendering.image_patch import Image

INK = (1.0, 0.9, 0.35)
# Dark on each side of a line, or it would be lost on bright objects.
HALO, RIM = (0.0, 0.0, 0.0, 0.55), 1.0
LIGHT, DARK = (0.96, 0.97, 0.99), (0.09, 0.09, 0.12)
# Of the rim around numbers, which keeps them legible on anything.
FAINT = 0.75

# Logical pixels: a line, half a cross at each end, an angle's arc, a number's way from its line,
# and its letters.
WIDTH, CROSS, ARC, AWAY, LETTERS = 2.0, 4.0, 26.0, 4.0, 14
ARC_LINES = 12

# Of an angle's side: how far out its length stands.
OUT = 2 / 3
# Logical pixels along its line and away from it, in the order tried, of a number that another one
# is in the way of. Away it soon stands clear, a line of text being lower than it is wide; from
# farther it would leap while the view turns.
STEPS = np.array(
    [
        (0.0, 0.0),
        *(
            (step * np.cos(angle), step * np.sin(angle))
            for step in (18.0, 36.0)
            for angle in np.radians([45, 135, 0, 180, 90])
        ),
    ]
)

# mm. Squares of what is much farther are no numbers.
FARTHEST = 1e100

Pixels = NDArray[np.float64]
DIAGONAL: Pixels = np.full(2, 0.5**0.5)


@dataclass(frozen=True, eq=False)
class Ruler:
    """A length or an angle as pictures show it.

    Parameters
    ----------
    owners : frozenset of int
        The objects that its points go along with, 0 for none.
    points : (N, 3) ndarray of float64
        Two, or three for an angle; mm of the scan.
    numbers : tuple of str
        Its lengths, then its angle, in words.
    """

    owners: frozenset[int]
    points: NDArray[np.float64]
    numbers: tuple[str, ...]


def ruler_pixels(
    owners: frozenset[int],
    points: NDArray[np.float64],
    projection_of: Callable[[int], Projection | None],
    size: tuple[int, int],
) -> Pixels | None:
    """Return the pixels of points that were measured; None where they cannot be shown.

    Parameters
    ----------
    owners : frozenset of int
        Whose points they are, 0 for none.
    points : (N, 3) ndarray of float64
        mm of the scan.
    projection_of : callable
        Returns how an object is seen now, None where it is not.
    size : (int, int)
        Height and width of the image, pixels.
    """
    first, *others = [projection_of(i) for i in owners]
    if first is None or np.abs(points).max() > FARTHEST:
        return None
    for other in others:
        # Between objects that stand apart now the line would be of another length than it says.
        if other is None or not np.allclose(other.pivot_from_scan, first.pivot_from_scan):
            return None
    return first.pixels(points, size)


def strokes_of(pixels: Pixels, scale: float) -> list[Pixels]:
    """Return the lines of a measurement: its sides, a cross at each point, an angle's arc.

    Parameters
    ----------
    pixels : (N, 2) ndarray of float64
        Its points.
    scale : float
        Pixels of a logical pixel.
    """
    cross = CROSS * scale * np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
    lines = [pixel + arm for pixel in pixels for arm in cross]
    if len(pixels) > 1:
        lines.append(pixels)
    if len(pixels) == 3:
        lines.append(arc(pixels, ARC * scale))
    return lines


def with_rulers(image: Image, drawn: Sequence[tuple[Pixels, Sequence[str]]], light: bool) -> Image:
    """Draw measurements over a premultiplied image.

    Parameters
    ----------
    image : (H, W, 4) ndarray of float32
    drawn : sequence of ((N, 2) ndarray of float64, sequence of str)
        Points and numbers of each.
    light : bool
        Whether the background is.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    if not drawn:
        return image
    size = image.shape[0], image.shape[1]
    # Sizes are those of an image 720 pixels high, as the scale bar's are.
    scale = max(min(size) / 720, 0.6)
    strokes = [line for pixels, _ in drawn for line in strokes_of(pixels, scale)]
    for half, ink in ((WIDTH / 2 + RIM, HALO), (WIDTH / 2, (*INK, 1.0))):
        image = _over(image, stroke_cover(strokes, size, half * scale), ink)
    font = ImageFont.load_default(size=max(9, round(LETTERS * scale)))
    assert isinstance(font, ImageFont.FreeTypeFont), "a size was asked for"
    boxes = [[(font.size, font.getlength(words)) for words in numbers] for _, numbers in drawn]
    middles = number_places([pixels for pixels, _ in drawn], boxes, size, scale)
    inks = (LIGHT, DARK) if light else (DARK, LIGHT)
    for rim, ink in ((max(1, round(scale)), (*inks[0], FAINT)), (0, (*inks[1], 1.0))):
        canvas = Pillow.new("L", (size[1], size[0]))
        pen = ImageDraw.Draw(canvas)
        for (_, numbers), places in zip(drawn, middles, strict=True):
            for words, (row, col) in zip(numbers, places, strict=True):
                write(pen, float(col), float(row) + font.size / 3, words, font, rim)
        image = _over(image, np.asarray(canvas, np.float32) / np.float32(255), ink)
    return image


def _over(
    image: Image, cover: NDArray[np.float32], ink: tuple[float, float, float, float]
) -> Image:
    alpha = cover[..., None] * np.float32(ink[3])
    laid: Image = alpha * np.array([*ink[:3], 1.0], np.float32) + (1 - alpha) * image
    return laid


def number_places(
    drawn: Sequence[Pixels],
    boxes: Sequence[Sequence[tuple[float, float]]],
    size: tuple[int, int],
    scale: float,
) -> list[list[Pixels]]:
    """Return where the numbers of measurements stand, clear of their lines and of each other.

    Parameters
    ----------
    drawn : sequence of (N, 2) ndarray of float64
        Points of each.
    boxes : sequence of sequence of (float, float)
        Height and width of the numbers of each: its lengths, then an angle.
    size : (int, int)
        Height and width of the image, pixels.
    scale : float
        Pixels of a logical pixel.

    Returns
    -------
    list of list of (2,) ndarray of float64
        The middle of every number, row and column; outside the image where its line is.
    """
    taken = np.empty((sum(map(len, boxes)), 4))
    count = 0

    def place(line: Pixels, spot: Pixels, way: Pixels, along: Pixels, half: Pixels) -> Pixels:
        nonlocal count
        if not _within(line, size):
            # At the edge it would seem to be of something there.
            return -2 * half
        beside = spot + way * (AWAY * scale + float(np.abs(way) @ half))
        # A number outside the window could not be read.
        most = np.maximum(np.array(size) - half, half)
        tried = np.clip(beside + scale * STEPS @ np.array([along, way]), half, most)
        others = taken[:count]
        apart = np.abs(tried[:, None] - others[:, :2]) >= half + others[:, 2:]
        # The first where all are in the way of something.
        found: Pixels = tried[apart.any(axis=2).all(axis=1).argmax()]
        taken[count] = *found, *half
        count += 1
        return found

    return [
        [
            place(*spot, np.array(box) / 2)
            for box, spot in zip(numbers, _spots(pixels, scale), strict=True)
        ]
        for pixels, numbers in zip(drawn, boxes, strict=True)
    ]


def _within(line: Pixels, size: tuple[int, int]) -> bool:
    """Return whether any piece of a line is in an image: whether no axis parts them."""
    half = np.array(size) / 2
    way = (line[1:] - line[:-1]) / 2
    middle = line[:-1] + way + 0.5 - half
    aside = np.abs(middle[:, 0] * way[:, 1] - middle[:, 1] * way[:, 0])
    near = (np.abs(middle) <= half + np.abs(way)).all(axis=1)
    return bool((near & (aside <= np.abs(way[:, ::-1]) @ half)).any())


def _spots(pixels: Pixels, scale: float) -> list[tuple[Pixels, Pixels, Pixels, Pixels]]:
    """Return a line, a point at it, the way from it and along, for each side and then an angle."""
    if len(pixels) == 2:
        along = _unit(pixels[1] - pixels[0])
        beside = np.array([along[1], -along[0]])
        # Below a line, or at its right.
        return [(pixels, pixels.mean(axis=0), beside if beside.sum() > 0 else -beside, along)]
    sides = [_unit(end - pixels[1]) for end in pixels[[0, 2]]]
    beside = np.array([sides[0][1], -sides[0][0]])
    # Of a straight angle both sides are inside.
    inwards = _unit(sides[0] + sides[1], beside)
    spots = []
    for own, other, end in zip(sides, sides[::-1], pixels[[0, 2]], strict=True):
        # Lengths stand outside, where the angle's number is not, and away from each other.
        outwards = _unit(own * (own @ other) - other, -beside)
        spot = pixels[1] + OUT * (end - pixels[1])
        spots.append((np.stack([pixels[1], end]), spot, outwards, own))
    bow = arc(pixels, ARC * scale)
    return [*spots, (bow, pixels[1] + ARC * scale * inwards, inwards, inwards)]


def _unit(way: Pixels, otherwise: Pixels = DIAGONAL) -> Pixels:
    """Return a direction, and another one where there is none: of points that are one pixel."""
    length = float(np.linalg.norm(way))
    return way / length if length > 1e-3 else otherwise


def arc(pixels: Pixels, radius: float) -> Pixels:
    """Return an arc about the middle one of three points, (N, 2).

    Parameters
    ----------
    pixels : (3, 2) ndarray of float64
    radius : float
        Not longer than half of either side.
    """
    sides = pixels[[0, 2]] - pixels[1]
    lengths = np.linalg.norm(sides, axis=1)
    radius = min(radius, 0.5 * float(lengths.min()))
    first, last = np.arctan2(sides[:, 0], sides[:, 1])
    # The short way round.
    turn = (last - first + np.pi) % (2 * np.pi) - np.pi
    angles = first + turn * np.linspace(0.0, 1.0, ARC_LINES + 1)
    points: Pixels = pixels[1] + radius * np.stack([np.sin(angles), np.cos(angles)], axis=1)
    return points
