"""Trilinear density at one point, clamped at the volume's edges."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def density_at(volume, z, y, x):  # type: ignore[no-untyped-def]
    """Interpolate the density at any point, in voxels; float32."""
    iz, iy, ix = np.int64(np.floor(z)), np.int64(np.floor(y)), np.int64(np.floor(x))
    fz, fy, fx = np.float32(z - iz), np.float32(y - iy), np.float32(x - ix)
    bottom, right, back = volume.shape[1] - 1, volume.shape[2] - 1, volume.shape[0] - 1
    z0, z1 = min(max(iz, 0), back), min(max(iz + 1, 0), back)
    y0, y1 = min(max(iy, 0), bottom), min(max(iy + 1, 0), bottom)
    x0, x1 = min(max(ix, 0), right), min(max(ix + 1, 0), right)
    ez, ey, ex = np.float32(1) - fz, np.float32(1) - fy, np.float32(1) - fx
    near = ey * (ex * np.float32(volume[z0, y0, x0]) + fx * np.float32(volume[z0, y0, x1])) + fy * (
        ex * np.float32(volume[z0, y1, x0]) + fx * np.float32(volume[z0, y1, x1])
    )
    far = ey * (ex * np.float32(volume[z1, y0, x0]) + fx * np.float32(volume[z1, y0, x1])) + fy * (
        ex * np.float32(volume[z1, y1, x0]) + fx * np.float32(volume[z1, y1, x1])
    )
    return ez * near + fz * far
