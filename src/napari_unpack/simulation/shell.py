"""The bag itself: a thin soft shell with piping and a zip, and the table it may lie on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.simulation.stacking import BLOCKED, Stack

# CT numbers + 1000: thin nylon, cord, a plastic zip; carbon skin and foam core of a table.
FABRIC, PIPING, ZIP = 190.0, 420.0, 700.0
SKIN, CORE = 1300.0, 90.0


@dataclass(frozen=True)
class Shell:
    """A box with rounded edges that holds everything, in voxels.

    Parameters
    ----------
    center, half : (float, float, float)
        Middle and half edges of the outer face.
    rounding, thickness : float
        Of the edges, and of the fabric.
    table : float
        Row at which the table begins; infinite without one.
    """

    center: tuple[float, float, float]
    half: tuple[float, float, float]
    rounding: float
    thickness: float
    table: float

    @classmethod
    def around(cls, shape: tuple[int, int, int], table: bool = False) -> Shell:
        """Return the shell that fills a volume, or what a table leaves of it.

        Parameters
        ----------
        shape : (int, int, int)
            Of the volume, voxels.
        table : bool
            Whether a table is below.
        """
        z, y, x = shape
        # A twentieth of the height is a scanner table of 2 cm below a bag of 40 cm.
        plate = max(4.0, 0.05 * y) if table else 0.0
        # Below 48 voxels a margin of two would cost things a tenth of their room.
        margin = 1.0 if min(shape) < 48 else 2.0
        half = (z / 2 - margin, (y - plate) / 2 - margin, x / 2 - margin)
        center = ((z - 1) / 2, (y - plate - 1) / 2, (x - 1) / 2)
        edge = y - plate - 0.5 if table else math.inf
        return cls(center, half, 0.13 * min(half) * 2, 1.0 if min(shape) < 48 else 1.6, edge)

    def room(self, shape: tuple[int, int, int]) -> Stack:
        """Return the empty room inside."""
        # Half a voxel more: voxel centres of things may not lie on the fabric's inner face.
        half = np.array(self.half) - self.thickness - 0.5
        # Fabric of one thickness has inner edges rounded by as much less.
        r = max(self.rounding - self.thickness, 0.5)
        z = np.maximum(np.abs(np.arange(shape[0]) - self.center[0]) - half[0] + r, 0.0)[:, None]
        x = np.maximum(np.abs(np.arange(shape[2]) - self.center[2]) - half[2] + r, 0.0)[None, :]
        rest = r * r - z * z - x * x
        reach = half[1] - r + np.sqrt(np.maximum(rest, 0.0))
        height = np.floor(self.center[1] + reach).astype(np.int32) + 1
        ceiling = np.ceil(self.center[1] - reach).astype(np.int32)
        height[rest < 0] = BLOCKED
        return Stack(height, np.maximum(ceiling, 0).astype(np.int32))

    def paint(self, density: NDArray[np.float32]) -> None:
        """Add the shell, and the table, to a volume of CT number + 1000, in place."""
        _paint(
            density, np.array(self.center), np.array(self.half), self.rounding, self.thickness,
            self.table, FABRIC, PIPING, ZIP, SKIN, CORE,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _paint(density, center, half, r, thick, table, fabric, piping, zipper, skin, core):  # type: ignore[no-untyped-def]
    depth, height, width = density.shape
    # The zip runs high on the side, where bags open.
    seam = center[1] - 0.42 * half[1]
    cord = 0.9 * thick
    for z in range(depth):
        az = abs(z - center[0]) - half[0] + r
        for y in range(height):
            if y > table:
                below = y - table
                # Two voxels of skin above, two below; foam between, as in carbon tables.
                plate = skin if below < 2.0 or y > height - 3 else core
                for x in range(width):
                    density[z, y, x] += plate
                continue
            ay = abs(y - center[1]) - half[1] + r
            for x in range(width):
                ax = abs(x - center[2]) - half[2] + r
                d = math.sqrt(max(az, 0.0) ** 2 + max(ay, 0.0) ** 2 + max(ax, 0.0) ** 2)
                d += min(max(az, ay, ax), 0.0) - r
                cover = min(max(0.5 + 0.5 * thick - abs(d + 0.5 * thick), 0.0), 1.0)
                if cover <= 0.0:
                    continue
                value = fabric
                round_side = math.hypot(max(az, 0.0), max(ax, 0.0)) - r
                wall = round_side > -1.5 * thick
                if wall and abs(y - seam) < cord:
                    # Teeth two voxels wide: the finest that the grid still shows.
                    tooth = (z + x) % 4 < 2
                    value = zipper if tooth else piping
                elif wall and abs(abs(y - center[1]) - half[1] + 0.6 * r) < cord:
                    value = piping
                density[z, y, x] += cover * value
