"""Slots: where unpacked objects wait, cells of a grid around the bag, in pivot space.

The bag is taken as the circle of its bounding sphere, so that a plan holds at every turn of it.
Slots are planned for more and more objects, in steps, so that the bag stays large while few are
out: between two steps nothing moves when another one comes out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import fixed

# Least length of a sprite's longer side, where the window has room for as many as there are.
LEAST_PIXELS = 64
# So many sprites stand in the window whatever its shape, if need be smaller than that.
MOST_INSIDE = 256
# Least distance in pixels between sprites, from the bag and from the window's edge.
GAP = 8
# Least distance from the edge, of the window's shorter side: in a large window it looks like none.
MARGIN = 0.02
# Least radius of the bag's circle, in the window's shorter side, for the sake of sprites.
LEAST_BAG = 0.27


# How much more a larger bag counts than larger sprites: with less, plans for more of them have
# larger bags than plans for few.
WEIGHT_OF_BAG = 2.0

# Sprites that the first plan has room for; there are corners for so many around any bag.
FEWEST = 4


@dataclass(frozen=True, eq=False)
class Slots:
    """Places for sprites, in the order in which they are filled.

    Parameters
    ----------
    centers : (N, 3) ndarray of float64
        Pivot space mm; the first coordinate is 0.
    cell_mm : float
        Side of a cell: a sprite's longer side is at most this.
    least_mm : float
        A sprite's longer side is at least this: `LEAST_PIXELS` pixels, or the cell's side where
        that is smaller.
    height_mm, width_mm : float
        Visible height and width at which the plan holds: the camera's `height`.
    bag_radius_px : float
        Radius of the bag's circle on the screen, perspective included.
    """

    centers: NDArray[np.float64]
    cell_mm: float
    least_mm: float
    height_mm: float
    width_mm: float
    bag_radius_px: float

    @property
    def window_mm(self) -> tuple[float, float]:
        """Visible height and width, mm."""
        return self.height_mm, self.width_mm

    def scale(self, width_mm: float, height_mm: float) -> float:
        """Return the enlargement of a sprite.

        True to the bag where the cell and the least size allow it.

        Parameters
        ----------
        width_mm, height_mm : float
            Of the sprite's image at scale 1.
        """
        longer = max(width_mm, height_mm)
        return float(np.clip(longer, self.least_mm, self.cell_mm) / longer)

    def beneath(self, center: NDArray[np.float64], side_mm: float) -> frozenset[int]:
        """Return the slots that a sprite at some other place lies over.

        Parameters
        ----------
        center : (3,) ndarray of float64
            Of the sprite, pivot space mm.
        side_mm : float
            Of the square that it is seen in.
        """
        away = np.abs(self.centers[:, 1:] - center[1:]).max(axis=1)
        return frozenset(np.flatnonzero(away < (self.cell_mm + side_mm) / 2).tolist())


def margin_pixels(height: float, width: float) -> float:
    """Return the least distance of what is fitted into a window from its edge, pixels.

    Parameters
    ----------
    height, width : float
        Of the window.
    """
    return max(GAP, MARGIN * min(height, width))


def room_for(taken: int, most: int) -> int:
    """Return for how many sprites to plan: 4, 8, 16, ..., or for all where that is not many more.

    Parameters
    ----------
    taken : int
        Slots that are taken, those among them counted that are empty again.
    most : int
        Objects in the bag.
    """
    planned = FEWEST
    while planned < taken:
        planned *= 2
    # One step more for a few would move everything once more for little.
    return most if 3 * planned >= 2 * most else planned


def arrange(
    count: int,
    bag_radius_mm: float,
    canvas_size: tuple[int, int],
    fov: float = 0.0,
) -> Slots:
    """Plan the places of all sprites around the bag.

    Parameters
    ----------
    count : int
        Slots wanted.
    bag_radius_mm : float
        Radius of the bag's bounding sphere about the camera's centre.
    canvas_size : (int, int)
        Height and width of the window in pixels.
    fov : float
        Vertical field of view in degrees; 0 is orthographic.

    Returns
    -------
    Slots
        No cell overlaps another, the bag's circle or, for the first `MOST_INSIDE`, the window's
        edge.

    Raises
    ------
    ValueError
        If `count` is negative, or the radius or the window's size is not positive.

    Notes
    -----
    For every cell side the grid's cells are sorted by distance from the middle; the bag may
    grow until `count` cells are left outside it. Of these the side is taken for which
    radius^WEIGHT_OF_BAG * side is largest. Where there is none of at least `LEAST_PIXELS`, sides
    and gaps shrink by a tenth until one is found, for the first `MOST_INSIDE`; further ones are
    planned beyond the window, where zooming out shows them. In perspective a sphere of radius r
    at distance d covers the circle r d / sqrt(d^2 - r^2) of the pivot plane.
    """
    if count < 0:
        raise ValueError(f"count must not be negative, got {count!r}")
    if not (np.isfinite(bag_radius_mm) and bag_radius_mm > 0):
        raise ValueError(f"bag_radius_mm must be a positive number, got {bag_radius_mm!r}")
    if min(canvas_size) < 1:
        raise ValueError(f"canvas_size must be at least (1, 1) pixels, got {canvas_size!r}")
    height, width = int(canvas_size[0]), int(canvas_size[1])
    # More sprites than that would be too small to be made out.
    inside = min(count, MOST_INSIDE)
    side, radius, between = _best_plan(inside, height, width)
    cells = _cells(count, height, width, side, radius, between)
    mm = _mm_per_pixel(bag_radius_mm, radius, height, fov)
    centers = fixed(np.concatenate([np.zeros((len(cells), 1)), cells * mm], axis=1))
    least = min(float(LEAST_PIXELS), side)
    return Slots(centers, side * mm, least * mm, height * mm, width * mm, radius)


@lru_cache(maxsize=64)
def _best_plan(count: int, height: int, width: int) -> tuple[float, float, float]:
    """Return the cell side, the radius of the bag's circle, and the gap, pixels."""
    short = min(height, width)
    most = float("inf")
    if count > FEWEST:
        # Never larger than with fewer sprites: the camera draws back as they come, and no way else.
        fewer = FEWEST * 2 ** int(np.log2((count - 1) / FEWEST))
        most = _best_plan(fewer, height, width)[1]
    plans = []
    # In steps of 2 pixels, which no one sees; beyond 0.3 of the window sprites outdo the bag.
    for side in np.arange(LEAST_PIXELS, max(LEAST_PIXELS, min(short * 0.3, 320)) + 1, 2):
        plan = _plan(count, height, width, side, GAP, most)
        if plan is not None:
            plans.append(plan)
    if plans:
        return max(plans, key=lambda plan: plan[1] ** WEIGHT_OF_BAG * plan[0])
    side = float(LEAST_PIXELS)
    while True:
        # A tenth at a time finds a side within a tenth of the largest that fits.
        side *= 0.9
        plan = _plan(count, height, width, side, min(GAP, side / 8), most)
        if plan is not None:
            return plan


def _plan(
    count: int, height: int, width: int, side: float, gap: float, most: float
) -> tuple[float, float, float] | None:
    """Return side, radius and gap where `count` cells fit outside a bag that is large enough."""
    short = min(height, width)
    edge = _edge(height, width, gap)
    # The bag may grow up to the nearest of the cells that are needed.
    reach = np.sort(_nearest(_grid(height, width, side, gap), side))[::-1] - gap
    if len(reach) < count:
        return None
    radius = min([most, short / 2 - edge, *reach[max(count - 1, 0) : count]])
    return (float(side), float(radius), gap) if radius >= LEAST_BAG * short else None


def _edge(height: float, width: float, gap: float) -> float:
    """Return the distance of cells from the window's edge; it shrinks as the gap does."""
    return margin_pixels(height, width) * min(1.0, gap / GAP)


def _grid(height: float, width: float, side: float, gap: float) -> NDArray[np.float64]:
    """Return (n, 2) centres, row and column from the window's middle, of the cells that fit."""
    axes = []
    edge = _edge(height, width, gap)
    for length in (height, width):
        n = max(0, int((length - 2 * edge + gap) // (side + gap)))
        # Columns are spread so that the outermost stand at the window's edge.
        room = length - 2 * edge - side
        axes.append(np.linspace(-room / 2, room / 2, n) if n > 1 else np.zeros(n))
    rows, columns = np.meshgrid(*axes, indexing="ij")
    return np.stack([rows.ravel(), columns.ravel()], axis=1)


def _nearest(cells: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Return the distance of every cell's nearest point from the middle."""
    return np.hypot(*np.maximum(np.abs(cells) - side / 2, 0.0).T)


def _cells(
    count: int, height: int, width: int, side: float, radius: float, gap: float
) -> NDArray[np.float64]:
    inside = _grid(height, width, side, gap)
    inside = _in_order(inside[_nearest(inside, side) >= radius + gap - 1e-9], height, width, side)
    if len(inside) >= count:
        return inside[:count]
    # Too small a window: further columns on the same pitch beyond its left and right edges,
    # where no window edge stands in the way of another row.
    pitch = side + gap
    rows = max(1, int((max(height, 2 * radius) + gap) // pitch))
    first = max(width / 2, radius + gap) + gap + side / 2
    more = -(-(count - len(inside)) // (2 * rows))
    vertical = (np.arange(rows) - (rows - 1) / 2) * pitch
    vertical = vertical[np.argsort(np.abs(vertical), kind="stable")]
    outside = [
        (row, sign * (first + k * pitch))
        for k in range(more)
        for row in vertical
        for sign in (1, -1)
    ]
    return np.concatenate([inside, np.array(outside)])[:count]


def _in_order(
    cells: NDArray[np.float64], height: float, width: float, side: float
) -> NDArray[np.float64]:
    """Order cells for filling: first those that the least of the window holds with the bag.

    The camera so draws back in few steps as objects come out. Of cells that need the same, rows
    go from the middle outwards, in a row near the bag first: sprites flank the bag and grow up
    and down, right and left in turn. Bags are wide rather than high, so that the cells in the
    corners, though near the circle, look far from the bag.
    """
    row, col = np.round(cells, 6).T
    part = np.maximum((np.abs(row) + side / 2) / height, (np.abs(col) + side / 2) / width)
    return cells[np.lexsort((col < 0, np.abs(col), row > 0, np.abs(row), np.round(part, 6)))]


def _mm_per_pixel(radius_mm: float, radius_px: float, height_px: int, fov: float) -> float:
    if fov == 0.0:
        return radius_mm / radius_px
    # In perspective a sphere covers more than its radius; see the notes of `arrange`.
    eye = height_px / (2 * float(np.tan(np.radians(fov) / 2)))
    return radius_mm * float(np.hypot(eye, radius_px)) / (radius_px * eye)
