"""Trilinear density and its central differences, clamped at the volume's edges."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def density_at(volume, z, y, x):  # type: ignore[no-untyped-def]
    """Interpolate the density at a point in voxels; float32."""
    iz, iy, ix = np.int64(np.floor(z)), np.int64(np.floor(y)), np.int64(np.floor(x))
    fz, fy, fx = np.float32(z - iz), np.float32(y - iy), np.float32(x - ix)
    z0, z1 = max(iz, 0), min(iz + 1, volume.shape[0] - 1)
    y0, y1 = max(iy, 0), min(iy + 1, volume.shape[1] - 1)
    x0, x1 = max(ix, 0), min(ix + 1, volume.shape[2] - 1)
    ez, ey, ex = np.float32(1) - fz, np.float32(1) - fy, np.float32(1) - fx
    near = ey * (ex * np.float32(volume[z0, y0, x0]) + fx * np.float32(volume[z0, y0, x1])) + fy * (
        ex * np.float32(volume[z0, y1, x0]) + fx * np.float32(volume[z0, y1, x1])
    )
    far = ey * (ex * np.float32(volume[z1, y0, x0]) + fx * np.float32(volume[z1, y0, x1])) + fy * (
        ex * np.float32(volume[z1, y1, x0]) + fx * np.float32(volume[z1, y1, x1])
    )
    return ez * near + fz * far


@njit(cache=True, nogil=True)
def gradient_at(volume, z, y, x):  # type: ignore[no-untyped-def]
    """Take central differences one voxel to both sides; three float32, density per voxel."""
    half = np.float32(0.5)
    return (
        half * (density_at(volume, z + 1, y, x) - density_at(volume, z - 1, y, x)),
        half * (density_at(volume, z, y + 1, x) - density_at(volume, z, y - 1, x)),
        half * (density_at(volume, z, y, x + 1) - density_at(volume, z, y, x - 1)),
    )
