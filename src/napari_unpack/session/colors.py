"""Hues that keep neighbours apart in a view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction
from napari_unpack.appearance.hues import spread_hues
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering import interference_in
from napari_unpack.session.ray_queries import Mask, RayQueries, Size
from napari_unpack.session.state import Placement
from napari_unpack.unpacking import Slots

# DT of eq. 1, pixels of the canvas, and LT, as `interference` has them by default.
DISTANCE = 5.0
LAYERS = 2

# Distance of the slots of neighbours, diagonal ones too, in sides of a cell: columns are spread up
# to the window's edges.
BESIDE = 1.7

# Fraction of every hue arc left empty between sprites, of which each has few neighbours: more than
# in the bag, and enough to tell two blues apart.
SPRITE_MARGIN = 0.5

# Longer side of the object-ID image hues are chosen from; larger canvases are scaled down, since
# which objects touch in a picture does not hang on its last pixels.
MOST_PIXELS = 640


def first_transfer_function(
    volume: NDArray[np.generic], labels: NDArray[np.uint16] | None = None
) -> TransferFunction:
    """Return what a session begins with: the default, or all opaque where there is one density.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density, finite somewhere.
    labels : (Z, Y, X) ndarray of uint16, optional
        Of the objects that should be seen.
    """
    try:
        return TransferFunction.default_for(volume, labels)
    except ValueError:
        # Labels that leave no background, as densities: nothing is to be told apart.
        most = float(np.finfo(np.float32).max)
        density = float(np.clip(volume[np.isfinite(volume)][0], -most, most))
        return TransferFunction([(density - max(abs(density), 1.0), 0.0), (density, 0.65)])


class Identity:
    """Makes a key of a mapping that is never changed in place: only itself is equal to it.

    Parameters
    ----------
    value : object
        Kept, so that nothing else can come to stand in its place in memory.
    """

    def __init__(self, value: object) -> None:
        self._value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and other._value is self._value

    def __hash__(self) -> int:
        return id(self._value)


@dataclass(frozen=True)
class VisibilityKey:
    """What interference in a view depends on.

    Parameters
    ----------
    revision : int
        Of the labels.
    camera : Camera
        Every movement makes another one.
    canvas_size : (int, int)
        Height and width, pixels.
    packed : frozenset of int
        Objects in the bag that do not fly.
    clipping : bytes
        The planes.
    """

    revision: int
    camera: Camera
    canvas_size: Size
    packed: frozenset[int]
    clipping: bytes


@dataclass(frozen=True)
class HuesKey:
    """What hues depend on.

    Parameters
    ----------
    visibility : VisibilityKey
    previous : Identity, optional
        Of the hues to keep where they still separate; None starts afresh.
    margin : float
        Fraction of every hue arc left empty.
    fixed : frozenset of (int, float)
        ID and hue of what keeps it: locked, or the nearest of the colour that a person gave.
    beside : tuple of (int, int)
        Objects outside the bag that stand beside each other.
    standing : Identity, optional
        Of the hues there are now, where any do.
    """

    visibility: VisibilityKey
    previous: Identity | None
    margin: float
    fixed: frozenset[tuple[int, float]]
    beside: tuple[tuple[int, int], ...] = ()
    standing: Identity | None = None


def pairs_beside(placements: Mapping[int, Placement], slots: Slots) -> tuple[tuple[int, int], ...]:
    """Return which objects outside the bag stand beside each other, each pair ascending.

    Parameters
    ----------
    placements : mapping of int to Placement
    slots : Slots
    """
    ids = sorted(placements)
    at = slots.centers[[placements[i].slot for i in ids], 1:].reshape(-1, 2)
    near = np.abs(at[:, None] - at).max(axis=-1) < BESIDE * slots.cell_mm
    return tuple((ids[a], ids[b]) for a, b in np.argwhere(np.triu(near, 1)))


def chosen_hues(graph: nx.Graph, key: HuesKey, hues: Mapping[int, float]) -> dict[int, float]:
    """Return hues that keep neighbours apart, from own colours too; runs on any thread.

    Parameters
    ----------
    graph : networkx.Graph
        From `find_interference`.
    key : HuesKey
    hues : mapping of int to float
        As they are, of all objects.
    """
    fixed = dict(key.fixed)
    known = fixed if key.previous is None else {**hues, **fixed}
    packed = spread_hues(graph, known, key.margin, fixed)
    beside = nx.Graph(sorted(key.beside))
    # As few change as can be, and those as little.
    return packed | spread_hues(beside, {**hues, **fixed}, SPRITE_MARGIN, fixed)


def find_interference(
    key: VisibilityKey,
    rays: RayQueries,
    visible: Mask,
    clipping: NDArray[np.float64],
    backend: str,
) -> nx.Graph:
    """Return which objects are near each other in a view (eq. 1); runs on any thread.

    Parameters
    ----------
    key : VisibilityKey
    rays : RayQueries
    visible : (M,) ndarray of bool
        By ID, what is packed.
    clipping : (N, 2, 3) ndarray of float64
        Planes, voxels.
    backend : {"auto", "cpu", "gl"}
    """
    # DT is in pixels of the canvas, so it is scaled with the image.
    scale = min(1.0, MOST_PIXELS / max(key.canvas_size))
    height, width = (max(1, round(n * scale)) for n in key.canvas_size)
    ids = rays.object_ids(key.camera, visible, (height, width), LAYERS, clipping, backend)
    return interference_in(ids, DISTANCE * scale, LAYERS, backend)
