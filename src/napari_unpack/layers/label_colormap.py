"""Colours by ID on napari's own Labels layers, quick for tens of thousands of objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from napari.utils.colormaps import CyclicLabelColormap, DirectLabelColormap
from numpy.typing import ArrayLike, NDArray

from napari_unpack.layers import compat

LabelColormap: TypeAlias = CyclicLabelColormap | DirectLabelColormap

# Beyond so many colours a `DirectLabelColormap` takes seconds to set, on the main thread.
MOST_DIRECT = 1000

# Rows a cyclic colormap can have; where it has one for every ID it cycles nowhere.
MOST_ROWS = 65_535


def label_colormap(colors: Mapping[int, ArrayLike], other: ArrayLike) -> LabelColormap:
    """Return a napari colormap that shows every ID in its colour.

    Parameters
    ----------
    colors : mapping of int to (4,) array_like
        Straight RGBA by ID, 0 and negative IDs left out.
    other : (4,) array_like
        Of all other IDs; 0 is transparent.

    Returns
    -------
    DirectLabelColormap or CyclicLabelColormap
        The former up to 1,000 colours and for IDs above 65,535. ID 65,535 itself may come out
        in the colour of ID 1: see `shared_row`.
    """
    top = max(colors, default=0)
    if len(colors) <= MOST_DIRECT or top > MOST_ROWS:
        direct: dict[int | None, Any] = {None: np.asarray(other, np.float32)}
        direct[0] = np.zeros(4, np.float32)
        direct |= {i: np.asarray(color, np.float32) for i, color in colors.items()}
        return compat.TabledColormap(color_dict=direct)
    table: NDArray[np.float32] = np.empty((min(top + 1, MOST_ROWS), 4), np.float32)
    table[:] = other
    table[0] = 0
    inside = [i for i in colors if i < len(table)]
    table[inside] = np.array([colors[i] for i in inside], np.float32)
    return CyclicLabelColormap(colors=table, background_value=0)


def shared_row(ids: ArrayLike) -> bool:
    """Return whether IDs 1 and 65,535 will share a colour in `label_colormap`."""
    some = np.asarray(ids)
    return bool(len(some) > MOST_DIRECT and len(some) and some.max() == MOST_ROWS)
