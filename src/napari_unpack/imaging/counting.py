"""Occlusion for everyone: who hides whom along a direction, and the ratios made of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import unit
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.counts import OcclusionCounts
from napari_unpack.geometry.view import Camera, View
from napari_unpack.imaging.arguments import (
    Labels,
    checked_labels,
    checked_size,
    checked_spacing,
    checked_view,
)
from napari_unpack.imaging.casting import cast_occlusion, off_faces, rays_for
from napari_unpack.imaging.pictures import step_scale
from napari_unpack.unpacking.occlusion import Definition, ratios

DEFINITIONS = get_args(Definition)
Method = Literal["one_pass", "queries"]
METHODS = get_args(Method)


def occlusion(
    labels: ArrayLike,
    spacing: ArrayLike = (1.0, 1.0, 1.0),
    view: View | Sequence[float] | None = None,
    size: Sequence[int] = (512, 512),
    hidden: Iterable[int] = (),
    backend: str = "auto",
    step: float | None = None,
    boxes: bool = False,
) -> OcclusionCounts:
    """Count how much of every object is hidden by others.

    Parameters
    ----------
    labels : (Z, Y, X) array_like of int
        Object IDs, 0 background.
    spacing : (3,) array_like
        Voxel size in mm, z y x.
    view : View or (3,) sequence of float, optional
        The view, made orthographic, or a direction of looking. Objects leave towards the
        viewer: along D, the opposite of the direction of looking.
    size : (int, int)
        Rays, height and width; at the voxel pitch or finer to decide what is free.
    hidden : iterable of int
        Objects that are as air.
    backend : {"auto", "cpu", "gl"}
    step : float, optional
        Distance of samples in mm, by default `min(spacing)`.
    boxes : bool
        Fill in `front_area`, at the cost of one more pass over the labels.

    Returns
    -------
    OcclusionCounts
        By the IDs given; memory is proportional to the largest.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    given = checked_labels(labels)
    return _renamed(_counted(given, spacing, view, size, hidden, backend, step, boxes), given)


def occlusion_ratios(
    labels: ArrayLike,
    spacing: ArrayLike = (1.0, 1.0, 1.0),
    view: View | Sequence[float] | None = None,
    definition: Definition = "first_hit",
    size: Sequence[int] = (512, 512),
    hidden: Iterable[int] = (),
    backend: str = "auto",
    step: float | None = None,
    method: Method = "one_pass",
) -> dict[int, float]:
    """Measure how much of every object is hidden by others, 0 being free.

    Parameters
    ----------
    labels, spacing, view, size, hidden, backend, step
        As for `occlusion`.
    definition : {"first_hit", "exact", "eq2", "first_hit_bbox", "listing"}
        What is counted, see Notes.
    method : {"one_pass", "queries"}
        All objects in one walk of the rays, or, with OpenGL and "first_hit" alone, the paper's
        occlusion queries: a pass an object within its box, up to 256 objects.

    Returns
    -------
    dict of int to float
        Ratio by ID, for every visible object that at least one ray meets.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.

    Notes
    -----
    Li et al. 2012, section 5.1; notes/readings.md 1. "eq2": samples on rays whose first object
    is another, over all samples. "first_hit": rays that meet the object behind another first
    object, over rays that meet it. "first_hit_bbox": the same over the pixels covered by the
    front faces of the object's box, as the paper approximates. "exact" (not in the paper):
    samples with any other object in front of them, re-entry counted, over all samples; zero is
    what a straight pull needs. "listing" is the paper's single-pass listing; the same as "eq2".
    """
    if definition not in DEFINITIONS:
        raise ValueError(f"definition must be one of {DEFINITIONS}, got {definition!r}")
    if method not in METHODS:
        raise ValueError(f"method must be one of {METHODS}, got {method!r}")
    given = checked_labels(labels)
    if method == "queries":
        if definition != "first_hit":
            raise ValueError(f'method "queries" measures "first_hit" alone, got {definition!r}')
        queried = _queried(given, spacing, view, size, hidden, step)
        return {given.name(label): ratio for label, ratio in queried.items()}
    boxes = definition == "first_hit_bbox"
    counts = _counted(given, spacing, view, size, hidden, backend, step, boxes)
    found = ratios(counts, definition)
    return {given.name(label): ratio for label, ratio in found.items()}


def _counted(
    given: Labels,
    spacing: ArrayLike,
    view: View | Sequence[float] | None,
    size: Sequence[int],
    hidden: Iterable[int],
    backend: str,
    step: float | None,
    boxes: bool,
) -> OcclusionCounts:
    mm, pixels = checked_spacing(spacing), checked_size(size)
    camera = _camera(given, mm, view)
    counts: OcclusionCounts = cast_occlusion(
        given.array, mm, camera, given.visible(hidden), pixels,
        step_scale=step_scale(step, mm), backend=backend,
    )  # fmt: skip
    if not boxes:
        return counts
    found = label_boxes(given.array)
    area = np.zeros(given.size)
    area[found.ids] = found.front_areas(mm, camera.direction) / (camera.height / pixels[0]) ** 2
    return replace(counts, front_area=area)


def _queried(
    given: Labels,
    spacing: ArrayLike,
    view: View | Sequence[float] | None,
    size: Sequence[int],
    hidden: Iterable[int],
    step: float | None,
) -> dict[int, float]:
    from napari_unpack.rendering import gl_backend

    mm, pixels = checked_spacing(spacing), checked_size(size)
    rays = rays_for(_camera(given, mm, view), pixels, mm, step_scale=step_scale(step, mm))
    found = gl_backend.first_hits(
        given.array, off_faces(rays), given.visible(hidden), label_boxes(given.array)
    )
    return found.ratios


def _camera(given: Labels, mm: NDArray[np.float64], view: View | Sequence[float] | None) -> Camera:
    if view is not None and not isinstance(view, View):
        z, y, x = unit(view, "view")
        view = View(direction=(float(z), float(y), float(x)))
    return checked_view(view).orthographic().camera(given.array.shape, mm)


def _renamed(counts: OcclusionCounts, given: Labels) -> OcclusionCounts:
    if given.names is None:
        return counts
    names = given.names
    length = int(names[-1]) + 1

    def spread(table: NDArray[np.int64]) -> NDArray[np.int64]:
        out = np.zeros(length, table.dtype)
        out[names] = table
        return out

    return OcclusionCounts(
        ids=names[counts.ids],
        samples=spread(counts.samples),
        hits=spread(counts.hits),
        occluded_hits=spread(counts.occluded_hits),
        occluded_samples=spread(counts.occluded_samples),
        exact_samples=spread(counts.exact_samples),
        blocks=counts.blocks,
        front_area=None if counts.front_area is None else spread(counts.front_area),  # type: ignore[arg-type]
    )
