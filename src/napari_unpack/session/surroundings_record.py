"""Surroundings as JSON, for saved sessions."""

from __future__ import annotations

import base64
import binascii
from typing import Any

import numpy as np

from napari_unpack.appearance import Background, Surroundings
from napari_unpack.session.fields import Fields


def surroundings_record(around: Surroundings) -> dict[str, Any]:
    """Return surroundings as an object of what JSON knows; a picture as PNG in base 64."""
    ground = around.background
    return {
        "name": ground.name,
        "colors": [list(color) for color in ground.colors],
        "picture": None if ground.picture is None else _encoded(ground.picture),
        "box": around.box,
        "scale": around.scale,
    }


def surroundings_from(fields: Fields) -> Surroundings:
    """Return the surroundings an object was made of.

    Raises
    ------
    ValueError
        If it says something that cannot be.
    """
    count = len(fields.items("colors"))
    if count not in (1, 2):
        raise ValueError(f"colors must be one or two, got {count}")
    colors = np.clip(fields.array("colors", (count, 4)), 0.0, 1.0)
    picture = _decoded(fields.text("picture")) if fields.has("picture") else None
    ground = Background(
        tuple((float(r), float(g), float(b), float(a)) for r, g, b, a in colors),
        picture,
        fields.text("name"),
    )
    return Surroundings(ground, fields.flag("box"), fields.flag("scale"))


def _encoded(picture: Any) -> str:
    import imageio.v3 as iio

    return base64.b64encode(iio.imwrite("<bytes>", picture, extension=".png")).decode()


def _decoded(text: str) -> Any:
    import imageio.v3 as iio

    try:
        picture = np.asarray(iio.imread(base64.b64decode(text, validate=True), extension=".png"))
    except (binascii.Error, OSError, ValueError, SyntaxError) as error:
        raise ValueError("picture must be a PNG in base 64") from error
    return Background.of(picture).picture
