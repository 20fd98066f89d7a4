"""A cutting plane and a clipping box as plain data, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from napari_unpack.geometry.axes import unit
from napari_unpack.io.json_fields import Fields
from napari_unpack.session.bag_cut import Cut


def cut_record(cut: Cut) -> dict[str, Any] | None:
    """Return a cut as plain data; None where there is none."""
    parts = {"plane": cut.plane, "box": cut.box}
    told = {name: pair.tolist() for name, pair in parts.items() if pair is not None}
    return told or None


def cut_from(fields: Fields) -> Cut:
    """Make the cut a record was made of.

    Raises
    ------
    ValueError
        If the plane has no direction, or the box no inside.
    """
    plane = fields.array("plane", (2, 3)) if fields.has("plane") else None
    box = fields.array("box", (2, 3)) if fields.has("box") else None
    if plane is not None:
        plane = np.stack([plane[0], unit(plane[1], "session.look.cut.plane")])
    if box is not None and not (box[0] < box[1]).all():
        raise ValueError("session.look.cut.box must have its lower corner below its upper one")
    return Cut(plane, box)
