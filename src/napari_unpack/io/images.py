"""Images as PNG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import checked_target, written_atomically


def straight_bytes(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert a premultiplied (H, W, 3 or 4) image from 0 to 1 to the straight uint8 of files.

    Raises
    ------
    ValueError
        If it is not a colour image.
    """
    # Files hold straight colours; a pixel without alpha has none, and stays black.
    picture = np.asarray(image, dtype=np.float32)
    if picture.ndim != 3 or picture.shape[2] not in (3, 4):
        raise ValueError(f"image must be (H, W, 3) or (H, W, 4), got shape {picture.shape}")
    if picture.shape[2] == 4:
        alpha = picture[..., 3:]
        color = np.divide(
            # Divided only where something is: 0 / 0 would warn, and leave NaN in the file.
            picture[..., :3],
            alpha,
            where=alpha > 0,
            out=np.zeros_like(picture[..., :3]),
        )
        picture = np.concatenate([color, alpha], axis=2)
    return np.rint(np.clip(picture, 0.0, 1.0) * 255).astype(np.uint8)


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """Return an image as the bytes of a PNG file."""
    import imageio.v3 as iio

    return bytes(iio.imwrite("<bytes>", pixels, extension=".png"))


def save_png(image: NDArray[Any], path: str | Path) -> Path:
    """Write an image as PNG.

    Parameters
    ----------
    image : (H, W, 4) or (H, W, 3) ndarray
        Premultiplied floats from 0 to 1, or straight uint8.
    path : str or Path
        The file, .png; its folder must exist.

    Raises
    ------
    ValueError
        If it is not a colour image, or the path does not end in .png.
    """
    target = checked_target(path, ".png")
    pixels = image if image.dtype == np.uint8 else straight_bytes(image)
    with written_atomically(target) as temporary:
        temporary.write_bytes(png_bytes(pixels))
    return target
