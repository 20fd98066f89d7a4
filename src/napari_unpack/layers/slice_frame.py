"""What a canvas shows of a layer in napari's 2D view: which slice, and where on the screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SliceFrame:
    """A slice on a canvas.

    Parameters
    ----------
    size : (int, int)
        Height and width of the canvas, device pixels.
    axes : (int, int)
        Axes of the layer's data that are shown, downwards and to the right.
    pixel_from_data : (2, 3) ndarray of float64
        From (downwards, right, 1), in voxels, to the pixel's row and column.
    """

    size: tuple[int, int]
    axes: tuple[int, int]
    pixel_from_data: NDArray[np.float64]

    def pixels(self, voxels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where points are seen, (N, 2) row and column; the axis not shown is left out.

        Parameters
        ----------
        voxels : (N, 3) ndarray of float64
            z y x.
        """
        shown = voxels[:, list(self.axes)]
        return shown @ self.pixel_from_data[:, :2].T + self.pixel_from_data[:, 2]
