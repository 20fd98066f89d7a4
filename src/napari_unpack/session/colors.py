"""Hues that keep neighbours apart in a view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import assign_hues
from napari_unpack.appearance.tints import Mode, Rgba, nearest_hue
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering import interference_in
from napari_unpack.session.ray_queries import Mask, RayQueries, Size

if TYPE_CHECKING:
    import networkx as nx

# DT of eq. 1, pixels of the canvas, and LT, as `interference` has them by default.
DISTANCE = 5.0
LAYERS = 2

# Longer side of the object-ID image hues are chosen from; larger canvases are scaled down, since
# which objects touch in a picture does not hang on its last pixels.
MOST_PIXELS = 640


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
    locked : frozenset of int
        Objects whose hue stays.
    own : frozenset of (int, float)
        ID and nearest hue of the objects that a person gave a colour.
    """

    visibility: VisibilityKey
    previous: Identity | None
    margin: float
    locked: frozenset[int]
    own: frozenset[tuple[int, float]] = frozenset()


def hues_of(colors: Mapping[int, Rgba], mode: Mode) -> frozenset[tuple[int, float]]:
    """Return ID and nearest hue of objects of an own colour, for `HuesKey.own`.

    Parameters
    ----------
    colors : mapping of int to (float, float, float, float)
        Straight RGBA by ID.
    mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    """
    return frozenset((i, nearest_hue(color, mode)) for i, color in colors.items())


def chosen_hues(
    graph: nx.Graph, previous: Mapping[int, float] | None, key: HuesKey
) -> dict[int, float]:
    """Return hues that keep neighbours apart, from own colours too; runs on any thread.

    Parameters
    ----------
    graph : networkx.Graph
        From `find_interference`.
    previous : mapping of int to float, optional
        As for `assign_hues`.
    key : HuesKey
    """
    own = dict(key.own)
    # What has its own colour stays as it is, and its neighbours give way to it.
    known = {**(previous or {}), **own} if own else previous
    return assign_hues(graph, known, key.margin, locked=key.locked | own.keys())


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
