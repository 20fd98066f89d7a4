"""Distinct colours for a view of any Labels layer: what is seen, what interferes, hues.

The view is taken down on the main thread; its colours are worked out on any.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import networkx as nx
import numpy as np
from napari.layers import Labels
from numpy.typing import NDArray

from napari_unpack.appearance import assign_hues, golden_hue, interference, tints_of
from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.label_colormap import MOST_ROWS, LabelColormap, label_colormap, shared_row
from napari_unpack.layers.placement import unit_ratios, units_of
from napari_unpack.rendering import cast_ids
from napari_unpack.rendering.validation import checked_labels
from napari_unpack.tasks import Task
from napari_unpack.viewer.slice_sync import own_colormap

if TYPE_CHECKING:
    import napari

# DT in pixels of the canvas and LT of eq. 1, and the empty part of every hue arc.
DISTANCE, LAYERS, MARGIN = 5.0, 2, 0.4

# Along the longer side of the image that is looked at: hues need no finer one.
MOST_PIXELS = 640

# With more objects in an image only those that touch are kept apart.
MANY = 4096

# Of objects out of sight, where there are too many to give all a hue.
GREY = (0.55, 0.55, 0.55, 1.0)

_BEFORE: WeakKeyDictionary[Labels, LabelColormap] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class VolumeView:
    """A three-dimensional view of labels.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
        As displayed.
    world_from_voxel : (4, 4) ndarray of float64
        Any affine.
    camera : Camera
        In that world.
    size : (int, int)
        Height and width of the canvas, pixels.
    """

    labels: NDArray[Any]
    world_from_voxel: Matrix
    camera: Camera
    size: tuple[int, int]

    def colormap(self) -> LabelColormap:
        """Return the colormap; may run on any thread."""
        given = checked_labels(_without_negatives(self.labels))
        spacing = np.linalg.norm(self.world_from_voxel[:3, :3], axis=0)
        scale = min(1.0, MOST_PIXELS / max(self.size))
        size = max(1, round(self.size[0] * scale)), max(1, round(self.size[1] * scale))
        ids = cast_ids(
            given.array,
            spacing,
            self.camera,
            given.visible(()),
            size,
            LAYERS,
            voxel_from_world=np.linalg.inv(self.world_from_voxel),
            backend="cpu",
        )
        seen: NDArray[Any] = ids if given.names is None else given.names[ids]
        return colormap_for(seen, DISTANCE * scale, _present(self.labels))


@dataclass(frozen=True, eq=False)
class SliceView:
    """A slice of labels.

    Parameters
    ----------
    labels : (H, W) ndarray of int
        As displayed.
    pixel : (float, float)
        Height and width of a pixel of it on the canvas, pixels.
    """

    labels: NDArray[Any]
    pixel: tuple[float, float]

    def colormap(self) -> LabelColormap:
        """Return the colormap; may run on any thread.

        Notes
        -----
        The slice is drawn with square pixels no finer than its own and no larger than
        `MOST_PIXELS`, so that distance means the same along both axes.
        """
        finest = min(self.pixel)
        height, width = (n * p / finest for n, p in zip(self.labels.shape, self.pixel, strict=True))
        scale = min(1.0, MOST_PIXELS / max(height, width))
        rows = _spread(self.labels.shape[0], max(1, round(height * scale)))
        cols = _spread(self.labels.shape[1], max(1, round(width * scale)))
        image = _without_negatives(self.labels)[np.ix_(rows, cols)]
        # At least neighbours interfere, however far one has zoomed in.
        distance = min(max(DISTANCE / finest * scale, 1.5), 12.0)
        return colormap_for(image, distance, _present(self.labels))


def color_task(viewer: napari.Viewer, layer: Labels) -> Task[LabelColormap]:
    """Return the task that works out colours for what a viewer shows of a layer now.

    Parameters
    ----------
    viewer, layer
        As for `layer_view`, which raises for this too.
    """
    view = layer_view(viewer, layer)
    return Task(layer, lambda _: view.colormap())


def layer_view(viewer: napari.Viewer, layer: Labels) -> VolumeView | SliceView:
    """Return what a viewer shows of a Labels layer now.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : napari.layers.Labels

    Raises
    ------
    ValueError
        If the layer is not seen with two dimensions or three.
    """
    data = layer.data[0] if layer.multiscale else layer.data
    missing = viewer.dims.ndim - layer.ndim
    shown = [axis - missing for axis in viewer.dims.displayed if axis >= missing]
    if len(shown) < 2:
        raise ValueError(f"{layer.name} is not shown in this view")
    ratios = unit_ratios(layer, units_of(viewer))
    point = np.asarray(viewer.dims.point)[missing:] / ratios
    at = np.clip(np.rint(layer.world_to_data(point)), 0, np.array(data.shape) - 1).astype(int)
    cut = tuple(slice(None) if axis in shown else int(at[axis]) for axis in range(layer.ndim))
    labels = np.transpose(np.asarray(data[cut]), np.argsort(np.argsort(shown)))
    zoom, matrix = viewer.scene.camera.zoom, _world_from_data(layer, at, shown)
    matrix[:-1] *= ratios[shown, None]
    if len(shown) == 2:
        down, right = np.linalg.norm(matrix[:-1, :-1], axis=0) * zoom
        return SliceView(labels, (float(down), float(right)))
    camera, height = viewer.scene.camera, viewer.canvas.size[0]
    looking = Camera.looking(
        camera.view_direction,
        camera.up_direction,
        camera.center,
        height / zoom,
        float(camera.perspective),
    )
    return VolumeView(labels, matrix, looking, tuple(viewer.canvas.size))


def colormap_for(ids: NDArray[Any], distance: float, present: NDArray[Any]) -> LabelColormap:
    """Return the colormap that keeps apart what is near in an image of IDs.

    Parameters
    ----------
    ids : (L, H, W) or (H, W) ndarray of int
        What is seen.
    distance : float
        DT of eq. 1 in its pixels.
    present : (N,) ndarray of int
        All IDs of the layer; those out of sight get hues of their own, or grey where IDs are
        above 65,535.
    """
    if len(_present(ids)) > MANY:
        distance = min(distance, 1.5)
    graph = interference(ids, distance)
    if shared_row(present) and 1 in graph and MOST_ROWS in graph:
        graph = nx.contracted_nodes(graph, 1, MOST_ROWS, self_loops=False)
    hues = assign_hues(graph, margin=MARGIN)
    if len(present) and present[-1] <= MOST_ROWS:
        hues = {int(i): golden_hue(int(i)) for i in present} | hues
        tints = tints_of(hues, int(present[-1]))
        return label_colormap({i: tints[i] for i in hues}, GREY)
    rows = {object_id: k for k, object_id in enumerate(hues, start=1)}
    tints = tints_of({rows[i]: hue for i, hue in hues.items()}, len(rows))
    return label_colormap({i: tints[row] for i, row in rows.items()}, GREY)


def put_on(layer: Labels, colormap: LabelColormap) -> None:
    """Show a layer in a colormap; what it had before can be given back.

    Parameters
    ----------
    layer : napari.layers.Labels
    colormap : LabelColormap
    """
    if layer not in _BEFORE:
        _BEFORE[layer] = own_colormap(layer)
    layer.colormap = colormap


def give_back(layer: Labels) -> bool:
    """Give a layer the colormap it had before the first `put_on`; False where there was none."""
    before = _BEFORE.pop(layer, None)
    if before is not None:
        layer.colormap = before
    return before is not None


def _without_negatives(labels: NDArray[Any]) -> NDArray[Any]:
    # napari paints negative IDs as it does others; they are no objects here.
    return np.maximum(labels, 0) if np.issubdtype(labels.dtype, np.signedinteger) else labels


def _present(labels: NDArray[Any]) -> NDArray[Any]:
    top = int(labels.max(initial=0))
    if top <= MOST_ROWS:
        there = np.zeros(top + 1, np.bool_)
        there[_without_negatives(labels)] = True
        return np.flatnonzero(there)[int(there[0]) :] if top else np.zeros(0, np.int64)
    found: NDArray[Any] = np.unique(labels)
    return found[found > 0]


def _spread(count: int, wanted: int) -> NDArray[np.int64]:
    return ((np.arange(wanted) + 0.5) * count / wanted).astype(np.int64)


def _world_from_data(layer: Labels, at: NDArray[Any], shown: list[int]) -> Matrix:
    """Return the map of the displayed axes, in their order, at a point of the others."""
    base = np.asarray(at, dtype=np.float64).copy()
    base[shown] = 0
    origin = np.asarray(layer.data_to_world(base), dtype=np.float64)[shown]
    matrix = np.eye(len(shown) + 1)
    matrix[:-1, -1] = origin
    for k, axis in enumerate(shown):
        step = base.copy()
        step[axis] = 1
        matrix[:-1, k] = np.asarray(layer.data_to_world(step))[shown] - origin
    return matrix
