"""The public functions of rendering: images, object-ID layers, interference and occlusion.

Each checks its arguments, renumbers labels above the kernels' range, and computes on the backend
asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Decorations, TransferFunction
from napari_unpack.appearance.interference_graph import checked_layers
from napari_unpack.geometry.axes import checked_spacing, number, transform_points, unit
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.masks import unmasked
from napari_unpack.geometry.occlusion_counts import OcclusionCounts, SparseTable, Table
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering.backends import checked_backend, chosen, on_cpu
from napari_unpack.rendering.casting import (
    TABLE_ENTRIES,
    TransferFunctionLike,
    cast_ids,
    cast_occlusion,
    cast_tinted,
    off_faces,
    rays_for,
)
from napari_unpack.rendering.cpu import Bricks, by_contribution, contributions
from napari_unpack.rendering.decorated_image import box_patch, on_background
from napari_unpack.rendering.image_patch import ImagePatch, compose
from napari_unpack.rendering.validation import (
    Labels,
    checked_labels,
    checked_planes,
    checked_size,
    checked_view,
    checked_volume,
)
from napari_unpack.unpacking.occlusion import Definition, ratios


def _given(labels: ArrayLike) -> Labels:
    """Check labels; the array is one of its own, over the same memory.

    A graphics card knows arrays by identity, and the caller's may be changed in place between
    calls. A session, which announces its changes, sends them once.
    """
    given = checked_labels(labels)
    return replace(given, array=given.array.view())


def interference_in(
    ids: ArrayLike, distance: float = 5, layers: int | None = None, backend: str = "auto"
) -> nx.Graph:
    """Join the objects that come near one another in a view; see `appearance.interference`.

    Parameters
    ----------
    ids, distance, layers
        As there.
    backend : {"auto", "cpu", "gl"}
        "auto" takes the graphics card where there is one; beyond its limits (OpenGL 4.3, 4096
        objects) the CPU answers. The answer is the same.

    Raises
    ------
    TypeError, ValueError
        As there; or if the backend is unknown, or "gl" where no GL context can be had.
    """
    stack = checked_layers(ids, distance, layers)
    return chosen(backend).interference(stack, distance)


PEELINGS = ("pixel", "object")


def object_id_layers(
    labels: ArrayLike,
    spacing: ArrayLike = (1.0, 1.0, 1.0),
    view: View | None = None,
    layers: int = 2,
    size: Sequence[int] = (512, 512),
    hidden: Iterable[int] = (),
    backend: str = "auto",
    step: float | None = None,
    peeling: str = "pixel",
) -> NDArray[np.int32] | NDArray[np.int64]:
    """List the objects under every pixel, nearest first.

    Parameters
    ----------
    labels : (Z, Y, X) array_like of int
    spacing : (3,) array_like, mm z y x
    view : View, optional
        The view; by default along +x, framing the volume.
    layers : int
        How many objects of a ray to list.
    size : (int, int)
        Height and width, pixels.
    hidden : iterable of int
        Objects that are as air.
    backend : {"auto", "cpu", "gl"}
    step : float, optional
        Distance of samples in mm, by default `min(spacing)`.
    peeling : {"pixel", "object"}
        What a layer leaves out: on each ray the objects found there in earlier layers, or
        everywhere whatever earlier layers show anywhere.

    Returns
    -------
    (layers, H, W) ndarray of int32, or int64 for IDs above its range
        The k-th distinct object on each ray, 0 where there is none; with "object" the first one
        of those that no earlier layer shows.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.

    Notes
    -----
    Li et al. 2012, section 4.2, peel by object: "assigning zero opacity to all the objects
    presented in the previous layers". An object that is seen beside another is then in no layer
    behind it; peeling by pixel keeps it, and is the default.
    """
    if number(layers, "layers") % 1 or layers < 1:
        raise ValueError(f"layers must be a positive integer, got {layers!r}")
    # int64 for large IDs, beside the kernels' int32.
    pixels = checked_size(size, 12 * int(layers))
    given, mm = _given(labels), checked_spacing(spacing)
    if peeling not in PEELINGS:
        raise ValueError(f"peeling must be one of {PEELINGS}, got {peeling!r}")
    camera = checked_view(view).camera(given.array.shape, mm)
    # On the CPU a few layers are read in less time than it takes to look over all bricks.
    bricks = None if on_cpu(backend) else Bricks.of(given.array)

    def cast(visible: NDArray[np.bool_], count: int) -> NDArray[np.int32]:
        scale = step_scale(step, mm)
        return cast_ids(
            given.array, mm, camera, visible, pixels, count,
            step_scale=scale, bricks=bricks, backend=backend,
        )  # fmt: skip

    shown = given.visible(hidden)
    ids = cast(shown, int(layers)) if peeling == "pixel" else _peeled(cast, shown, int(layers))
    if given.names is None:
        return ids
    # int32 is what kernels give; only IDs that do not fit it cost twice the memory.
    wide = np.int32 if given.names[-1] <= np.iinfo(np.int32).max else np.int64
    return np.take(given.names.astype(wide), ids)


def _peeled(
    cast: Callable[[NDArray[np.bool_], int], NDArray[np.int32]],
    shown: NDArray[np.bool_],
    layers: int,
) -> NDArray[np.int32]:
    """Cast one layer after another, each without all that those before it show."""
    left, found = shown.copy(), []
    for _ in range(layers):
        found.append(cast(left, 1))
        # Peeling by object: what a layer shows anywhere is air in the next.
        left[np.unique(found[-1])] = False
    return np.concatenate(found)


def render(
    volume: ArrayLike,
    labels: ArrayLike,
    spacing: ArrayLike = (1.0, 1.0, 1.0),
    view: View | None = None,
    transfer_function: TransferFunctionLike | None = None,
    tints: Mapping[int, Sequence[float]] | None = None,
    hidden: Iterable[int] = (),
    size: Sequence[int] = (1024, 1024),
    backend: str = "auto",
    shading: Shading | None = Shading(),  # noqa: B008 (frozen)
    step: float | None = None,
    jitter: bool = False,
    clipping: ArrayLike | None = None,
    background: object = None,
    decorations: Iterable[str] = (),
) -> NDArray[np.float32]:
    """Cast a tinted image of a volume.

    Parameters
    ----------
    volume : (Z, Y, X) array_like of real numbers
        Density; NaN counts as the lowest.
    labels : (Z, Y, X) array_like of int
        Object IDs, 0 for matter without a label.
    spacing : (3,) array_like, mm z y x
    view : View, optional
        The view; by default along +x, framing the volume.
    transfer_function : TransferFunctionLike, optional
        By default `appearance.TransferFunction.default_for(volume, labels)`.
    tints : mapping of int to (r, g, b) or (r, g, b, a), optional
        By ID; 0 is matter without a label. What is not listed is white and opaque.
    hidden : iterable of int
        Objects not drawn; 0 hides matter without a label.
    size : (int, int)
        Height and width, pixels.
    backend : {"auto", "cpu", "gl"}
    shading : Shading, optional
    step : float, optional
        Distance of samples in mm, by default `min(spacing)`.
    jitter : bool
        Trade banding for grain.
    clipping : (N, 2, 3) array_like, optional
        Up to 8 planes (point, normal) in voxels; what lies behind one is cut away.
    background : optional
        What is behind everything: a name such as "dark", "light", "dusk" or "daylight",
        "#rrggbb", RGB or RGBA numbers, a pair of these (top, bottom), or an image or its path;
        by default nothing, the image stays transparent.
    decorations : iterable of str
        "box": the edges of the box around all objects; "scale": a scale bar in mm.

    Returns
    -------
    (H, W, 4) ndarray of float32
        Premultiplied RGBA.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    given, mm, pixels = _given(labels), checked_spacing(spacing), checked_size(size)
    density = checked_volume(volume, given.array.shape).view()
    camera = checked_view(view).camera(given.array.shape, mm)
    scale, planes = step_scale(step, mm), checked_planes(clipping)
    around = Decorations.of((0, 0, 0, 0) if background is None else background, decorations)
    look = _checked_look(transfer_function or default_for(volume, density, given.array))
    image, depth = cast_tinted(
        density, given.array, mm, camera, look,
        given.tints(tints, hidden), pixels,
        step_scale=scale, shading=shading, bricks=Bricks.of(given.array, density),
        jitter=jitter, clipping=planes, backend=backend,
    )  # fmt: skip
    boxes = label_boxes(given.array) if around.box else None
    if boxes is not None and len(boxes.ids):
        middle = (boxes.lower.min(axis=0) + boxes.upper.max(axis=0) - 1) / 2 * mm
        # Patches are put together by depth: that of the box is its middle.
        plane = -float(transform_points(camera.pivot_from_world(), middle)[0])
        bag = ImagePatch(image, depth, 0, 0, plane)
        image = compose(pixels, [bag, box_patch(boxes, mm, camera, pixels, around)])
    return on_background(image, camera, around)


def pick(
    volume: ArrayLike,
    labels: ArrayLike,
    spacing: ArrayLike = (1.0, 1.0, 1.0),
    view: View | None = None,
    pixel: Sequence[int] = (0, 0),
    size: Sequence[int] = (512, 512),
    transfer_function: TransferFunctionLike | None = None,
    tints: Mapping[int, Sequence[float]] | None = None,
    hidden: Iterable[int] = (),
    step: float | None = None,
    clipping: ArrayLike | None = None,
    backend: str = "auto",
) -> list[tuple[int, float]]:
    """Tell what a pixel of the tinted image shows.

    Parameters
    ----------
    volume, labels, spacing, view, size, transfer_function, tints, hidden, step, clipping
        As for `render`.
    pixel : (int, int)
        Row and column.
    backend : {"auto", "cpu", "gl"}
        Checked only: a single ray is cast on the CPU whichever it is.

    Returns
    -------
    list of (int, float)
        Objects and their contributions to the pixel's alpha: the one that contributes most,
        then those behind it by depth, then those in front of it. Empty where there is none.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above, or the pixel lies outside the image.

    Notes
    -----
    docs/paper.md, R13: the largest contribution wins; stepping deeper walks down the list.
    """
    # An unknown name is refused as everywhere, but no GL context is made for one ray.
    chosen(backend if backend not in ("auto", "gl") else "cpu")
    # A single ray is cast, however many pixels there are.
    given, mm, pixels = checked_labels(labels), checked_spacing(spacing), checked_size(size, 0)
    density = checked_volume(volume, given.array.shape)
    if len(pixel) != 2 or not all(0 <= at < most for at, most in zip(pixel, pixels, strict=True)):
        raise ValueError(f"pixel must lie inside a picture of {pixels}, got {pixel!r}")
    row, col = int(pixel[0]), int(pixel[1])
    camera = checked_view(view).camera(given.array.shape, mm)
    rays = rays_for(camera, pixels, mm, step_scale=step_scale(step, mm), window=(row, col, 1, 1))
    # The same function as `render` takes, or a click would pick what is not seen.
    look = _checked_look(transfer_function or default_for(volume, density, given.array))
    shares = contributions(
        density, given.array, rays, mm, look.table(TABLE_ENTRIES), look.domain,
        given.tints(tints, hidden), clipping=checked_planes(clipping),
    )  # fmt: skip
    return [(given.name(label), share) for label, share in by_contribution(shares)]


def default_for(
    volume: ArrayLike,
    density: NDArray[np.uint16] | NDArray[np.float32],
    labels: NDArray[np.uint16],
) -> TransferFunction:
    """Return the transfer function a volume gets when none is asked for.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
    density : (Z, Y, X) ndarray of uint16 or float32
        What kernels take of it.
    labels : (Z, Y, X) ndarray of uint16
        Of the objects that should be seen.
    """
    given, measured = unmasked(volume, np.nan), density
    # What stands in for NaN and infinities is no density of the scan.
    if given.dtype.kind == "f" and not (known := np.isfinite(given)).all():
        measured = given if given.dtype == np.float32 else np.where(known, density, np.nan)
    return TransferFunction.default_for(measured, labels)


def _checked_look(look: TransferFunctionLike) -> TransferFunctionLike:
    """Refuse a domain that is not two finite densities, low before high."""
    low, high = look.domain
    if not -np.inf < low < high < np.inf:
        raise ValueError(
            f"transfer_function must have a domain (low, high), low below high, got {look.domain!r}"
        )
    return look


# Of the shortest voxel edge. Interpolation between voxels is linear: finer steps show nothing
# more, and a ray through 1000 voxels takes 100,000 samples at most.
FINEST_STEP = 0.01

# mm, as of voxels: beyond it numbers of single precision end.
LONGEST_STEP = 1e9


def step_scale(step: float | None, spacing: NDArray[np.float64]) -> float:
    """Return a step in mm as a multiple of `min(spacing)`; raise ValueError unless positive.

    Parameters
    ----------
    step : float, optional
        mm; by default `min(spacing)`.
    spacing : (3,) ndarray of float64, mm z y x

    Raises
    ------
    ValueError
        If the step is not positive, finer than shows anything, or longer than anything.
    """
    if step is None:
        return 1.0
    least = FINEST_STEP * float(spacing.min())
    if not least <= step <= LONGEST_STEP:
        raise ValueError(
            f"step must be a number of mm, {least:g} (a hundredth of the shortest voxel edge) to "
            f"{LONGEST_STEP:g}, got {step!r}"
        )
    return float(step / spacing.min())


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
    labels, spacing, view, size, hidden, backend, step
        As for `occlusion_ratios`.
    boxes : bool
        Fill in `front_area`, at the cost of one more pass over the labels.

    Returns
    -------
    OcclusionCounts
        By the IDs given.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    given = _given(labels)
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
    """Measure how much of every object is hidden by others, 0 being unpackable.

    Parameters
    ----------
    labels : (Z, Y, X) array_like of int
    spacing : (3,) array_like, mm z y x
    view : View or (3,) sequence of float, optional
        The view, made orthographic, or a direction of looking. Objects leave towards the
        viewer: along D, the opposite of the direction of looking.
    definition : {"first_hit", "exact", "eq2", "first_hit_bbox", "listing"}
        What is counted, see Notes.
    size : (int, int)
        Rays, height and width; at the voxel pitch or finer to decide which objects are unpackable.
    hidden : iterable of int
        Objects that are as air.
    backend : {"auto", "cpu", "gl"}
    step : float, optional
        Distance of samples in mm, by default `min(spacing)`.
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
    Li et al. 2012, section 5.1; docs/paper.md, R1. "eq2": samples on rays whose first object
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
    given = _given(labels)
    if method == "queries":
        if definition != "first_hit":
            raise ValueError(f'method "queries" measures "first_hit" alone, got {definition!r}')
        if checked_backend(backend) == "cpu":
            raise ValueError('method "queries" asks the graphics card: backend "cpu" cannot')
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
    # Fewer rays than the largest face has voxels are cast in less time than bricks are made.
    fine = pixels[0] * pixels[1] >= given.array.size / min(given.array.shape)
    counts: OcclusionCounts = cast_occlusion(
        given.array, mm, camera, given.visible(hidden), pixels, step_scale=step_scale(step, mm),
        bricks=Bricks.of(given.array) if fine else None, backend=backend,
    )  # fmt: skip
    if not boxes:
        return counts
    found = label_boxes(given.array)
    area = np.zeros(given.size)
    # In pixels, as hits are counted in rays.
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
    from napari_unpack.rendering.gl import backend as gl_backend

    mm, pixels = checked_spacing(spacing), checked_size(size)
    rays = rays_for(_camera(given, mm, view), pixels, mm, step_scale=step_scale(step, mm))
    found = gl_backend.first_hits(
        given.array, off_faces(rays), given.visible(hidden), label_boxes(given.array),
        Bricks.of(given.array),
    )  # fmt: skip
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

    # An ID may be anything up to 2**63: a table with a row each would hold terabytes of zeros.
    def spread(table: Table) -> SparseTable:
        return SparseTable(names, np.asarray(table))

    return OcclusionCounts(
        ids=names[counts.ids],
        samples=spread(counts.samples),
        hits=spread(counts.hits),
        occluded_hits=spread(counts.occluded_hits),
        occluded_samples=spread(counts.occluded_samples),
        exact_samples=spread(counts.exact_samples),
        blocks=counts.blocks,
        front_area=None if counts.front_area is None else spread(counts.front_area),
    )
