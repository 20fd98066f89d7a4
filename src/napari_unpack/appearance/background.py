"""What is behind an image: one colour, a gradient from top to bottom, or another image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import given_path
from napari_unpack.read_errors import read_errors_told

Color = tuple[float, float, float, float]

# Names anyone can ask for, and their colours from the top down.
NAMED: dict[str, tuple[str, ...]] = {
    "dark": ("#0e1014",),
    "dusk": ("#39424f", "#0c0e12"),
    "light": ("#f2f3f5",),
    "daylight": ("#ffffff", "#c3cad4"),
    "black": ("#000000",),
    "white": ("#ffffff",),
}


@dataclass(frozen=True, eq=False)
class Background:
    """What is behind an image.

    Parameters
    ----------
    colors : tuple of (r, g, b, a)
        Straight, in [0, 1]: one for all, or one at the top and one at the bottom.
    image : (H, W, 3) ndarray of uint8, optional
        In place of the colours, scaled until it covers and cut at the edges.
    name : str
        What it was asked for as.
    """

    colors: tuple[Color, ...]
    image: NDArray[np.uint8] | None = None
    name: str = ""

    @classmethod
    def of(cls, wanted: Any) -> Background:
        """Make a background of whatever one may ask for.

        Parameters
        ----------
        wanted : str, sequence, ndarray, Path or Background
            A name of `NAMED`, "#rrggbb", two of these with a comma between (top, bottom), RGB
            or RGBA numbers in [0, 1], a pair of any of these, an (H, W, 3 or 4) image, or the
            path of one.

        Raises
        ------
        ValueError
            If it is none of these.
        """
        if isinstance(wanted, Background):
            return wanted
        if isinstance(wanted, np.ndarray) and wanted.ndim > 2:
            picture = _checked_picture(wanted)
            return cls((_mean_color(picture),), picture, "picture")
        if isinstance(wanted, str) and wanted.lower() in NAMED:
            name = wanted.lower()
            return cls(tuple(_color(c) for c in NAMED[name]), name=name)
        if isinstance(wanted, str | Path) and is_picture(wanted):
            return cls.of(_read(given_path(wanted)))
        if isinstance(wanted, str):
            wanted = wanted.split(",")
        try:
            several = isinstance(wanted[0], str) or not np.isscalar(wanted[0])
        except (TypeError, LookupError) as error:
            raise ValueError(f"background must be a colour or a picture, got {wanted!r}") from error
        if several:
            if len(wanted) > 2:
                raise ValueError(f"background must be one or two colours, got {wanted!r}")
            return cls(tuple(_color(part) for part in wanted))
        return cls((_color(wanted),))

    @property
    def is_light(self) -> bool:
        """Whether dark writing is read better on it than white."""
        mean = np.mean([[c * a for c in rgb] for *rgb, a in self.colors], axis=0)
        # Luminance weights of sRGB (Rec. 709): green looks brightest.
        return bool(mean @ (0.2126, 0.7152, 0.0722) > 0.5)

    @property
    def is_plain(self) -> bool:
        """Whether it is one colour."""
        return self.image is None and len(self.colors) == 1

    def paint(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return it as an (H, W, 4) float32 image, premultiplied; read-only, kept a while."""
        return _painted(self, size)


@lru_cache(maxsize=4)
def _painted(background: Background, size: tuple[int, int]) -> NDArray[np.float32]:
    if background.image is not None:
        image = _covering(background.image, size)
    else:
        down = np.linspace(0.0, 1.0, size[0])[:, None]
        top, bottom = np.array(background.colors[0]), np.array(background.colors[-1])
        rows = (1 - down) * top + down * bottom
        # Images are premultiplied inside.
        rows[:, :3] *= rows[:, 3:]
        image = np.repeat(rows[:, None].astype(np.float32), size[1], axis=1)
    # It is kept for the next image of this size.
    image.flags.writeable = False
    return image


def is_picture(wanted: str | Path) -> bool:
    """Tell whether a background that is asked for by a word is a picture's file.

    Parameters
    ----------
    wanted : str or Path
        A name out of `NAMED` or colours; a path where it has a point or a slash.

    Raises
    ------
    ValueError
        If it is a path, and no file is there.
    """
    if isinstance(wanted, str) and wanted.lower() in NAMED:
        return False
    if isinstance(wanted, Path) or "." in wanted or "/" in wanted:
        if not given_path(wanted).is_file():
            raise ValueError(f"background: there is no picture {str(wanted)!r}")
        return True
    return False


def _read(path: Path) -> NDArray[Any]:
    import imageio.v3 as iio

    # By name: what Pillow cannot read, imageio would hand to ITK and to ffmpeg.
    with read_errors_told(path, "a picture"):
        # Of a file that may not be read, imageio does not say so.
        path.open("rb").close()
        # Of an animation the first frame.
        kind = iio.immeta(path, plugin="pillow", index=0)["mode"]
        # Grey of more than 8 bits stays as it is: Pillow would cut it off at 255.
        mode = None if kind.startswith(("I", "F")) else "RGB"
        picture: NDArray[Any] = np.asarray(iio.imread(path, plugin="pillow", index=0, mode=mode))
    return np.stack([picture] * 3, axis=2) if picture.ndim == 2 else picture


def _checked_picture(picture: NDArray[Any]) -> NDArray[np.uint8]:
    if picture.ndim != 3 or picture.shape[2] not in (3, 4) or 0 in picture.shape:
        raise ValueError(f"background must be an (H, W, 3 or 4) picture, got {picture.shape}")
    rgb = picture[..., :3]
    if rgb.dtype == np.uint8:
        return np.ascontiguousarray(rgb)
    return np.rint(np.clip(rgb / _white(rgb), 0, 1) * 255).astype(np.uint8)


def _white(rgb: NDArray[Any]) -> float:
    """Return the value of a picture's white."""
    whole = np.issubdtype(rgb.dtype, np.integer)
    if whole and rgb.dtype.itemsize <= 2:
        return float(np.iinfo(rgb.dtype).max)
    # Wider numbers and floats hold any kind of picture: only its lightest value tells which.
    lightest = float(rgb.max())
    # Where it was made smaller or sharper, it may be a little beyond white; highlights of a
    # picture of light are far beyond.
    if not whole and np.quantile(rgb, 0.99) <= 2.0:
        return 1.0
    if np.issubdtype(rgb.dtype, np.unsignedinteger) and lightest > 65535:
        return float(np.iinfo(rgb.dtype).max)
    for white in (255.0, 65535.0):
        if lightest <= white:
            return white
    raise ValueError(
        f"background must be a picture of values up to 1, 255 or 65,535, got {lightest:g}"
    )


def _mean_color(picture: NDArray[np.uint8]) -> Color:
    r, g, b = (float(v) for v in picture.reshape(-1, 3).mean(axis=0) / 255)
    return r, g, b, 1.0


def _covering(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.float32]:
    from skimage.transform import resize

    height, width = picture.shape[:2]
    # The larger of both, so that it covers the image, cut at two edges.
    scale = max(size[0] / height, size[1] / width)
    rows, cols = min(height, round(size[0] / scale)), min(width, round(size[1] / scale))
    top, left = (height - rows) // 2, (width - cols) // 2
    cut = picture[top : top + max(rows, 1), left : left + max(cols, 1)]
    image = np.ones((*size, 4), np.float32)
    image[..., :3] = resize(cut, size, order=1, anti_aliasing=scale < 1)
    return image


def _color(wanted: str | Sequence[float]) -> Color:
    if isinstance(wanted, str):
        text = wanted.strip().lower()
        if text in NAMED:
            text = NAMED[text][0]
        digits = text.lstrip("#")
        if len(digits) != 6 or any(c not in "0123456789abcdef" for c in digits):
            raise ValueError(
                f"background must be one of {', '.join(NAMED)}, '#rrggbb', two of these with a "
                f"comma between, numbers, or a picture; got {wanted!r}"
            )
        wanted = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    try:
        values = [float(v) for v in wanted]
    except TypeError as error:
        raise ValueError(f"background must be RGB or RGBA in [0, 1], got {wanted!r}") from error
    if len(values) not in (3, 4) or not all(0.0 <= v <= 1.0 for v in values):
        raise ValueError(f"background must be RGB or RGBA in [0, 1], got {wanted!r}")
    r, g, b, a = [*values, 1.0][:4]
    return r, g, b, a
