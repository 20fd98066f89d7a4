"""How the session's world, in mm, lies in napari's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Layer
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit, assumed_besides_size
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.geometry.transforms import turns_and_moves

if TYPE_CHECKING:
    import napari
    import pint

    from napari_unpack.layers.compat import PictureLayer

# All that says where a napari layer stands.
FIELDS = ("scale", "translate", "rotate", "shear", "affine", "units")


def placement_of(sources: Sequence[Layer], spacing: NDArray[np.float64]) -> dict[str, Any]:
    """Return where our layers stand: on the user's own layer.

    Parameters
    ----------
    sources : sequence of napari layers
        The session's volume and labels come from the first of three dimensions or more.
    spacing : (3,) ndarray of float64
        Voxel size of the session, mm z y x, for a session that comes from no layer.

    Returns
    -------
    dict
        Arguments of a napari layer whose data are voxels.
    """
    layer = next((layer for layer in sources if layer.ndim >= 3), None)
    # The very same, or the bag would stand beside the slices it is of.
    return {"scale": np.asarray(spacing, dtype=np.float64)} if layer is None else place_of(layer)


def units_of(viewer: napari.Viewer) -> Sequence[Any] | None:
    """Return the units a viewer draws in, the finest of its layers'; None where they clash."""
    units: Sequence[Any] | None = viewer.layers.extent.units
    return units


def data_to_world(layer: Layer, units: Sequence[Any] | None = None) -> Matrix:
    """Return a layer's (4, 4) map from its data to napari's world, both by z y x alone.

    Parameters
    ----------
    layer : napari layer
    units : sequence of pint.Unit, optional
        Of that world (`units_of`), by default the layer's own.
    """
    # By its images of points: napari keeps the parts of the map in private.
    points = np.vstack([np.zeros(layer.ndim), np.eye(layer.ndim)[-3:]])
    origin, *ends = (np.asarray(layer.data_to_world(point))[-3:] for point in points)
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    matrix[:3, :3] = np.stack(ends, axis=1) - origin[:, None]
    matrix[:3] *= unit_ratios(layer, units)[-3:, None]
    return matrix


def place_of(layer: Layer) -> dict[str, Any]:
    """Return where a layer stands, as arguments of a 3D layer: without time or channels."""
    if layer.ndim == 3:
        return {name: getattr(layer, name) for name in FIELDS}
    # The scale is in the affine already; ours have one of their own otherwise.
    return {"scale": np.ones(3), "affine": data_to_world(layer), "units": layer.units[-3:]}


def unit_ratios(layer: Layer, units: Sequence[Any] | None) -> NDArray[np.float64]:
    """Return how many units of a world each unit of a layer's is, along its axes.

    Parameters
    ----------
    layer : napari layer
    units : sequence of pint.Unit or None
        Of the world; None where units clash: ones.
    """
    # Then napari draws the numbers as they are, whatever their units.
    if units is None or len(units) < layer.ndim:
        return np.ones(layer.ndim)
    pairs = zip(layer.units, units[-layer.ndim :], strict=True)
    return np.array([float((1.0 * own).to(other).magnitude) for own, other in pairs])


def napari_from_world(layer: PictureLayer, units: Sequence[Any] | None) -> Matrix:
    """Return the map from the session's world, mm, to napari's.

    Parameters
    ----------
    layer : PictureLayer
        One of ours.
    units : sequence of pint.Unit or None
        Of napari's world (`units_of`).
    """
    return data_to_world(layer, units) @ voxel_from_world(layer.spacing)


def scene_from_world(layer: PictureLayer, units: Sequence[Any] | None) -> Matrix:
    """Return the map from the session's world, mm, to what napari's camera looks at.

    Parameters
    ----------
    layer, units
        As for `napari_from_world`.

    Returns
    -------
    (4, 4) ndarray of float64
        To napari's world, its axes in the order in which they are displayed.
    """
    return ordered(layer.axis_order) @ napari_from_world(layer, units)


def ordered(axes: Sequence[int]) -> Matrix:
    """Return the (4, 4) map of points to another order of their axes.

    Parameters
    ----------
    axes : (3,) sequence of int
        Which of z, y, x (0, 1, 2) comes first, second and third.
    """
    # An odd order is a mirror, which becomes the camera's stretch.
    return np.eye(4)[[*axes, 3]]


def scanner_from_scan(layer: Layer) -> Matrix | None:
    """Return where the scan of a layer lies, see `Scan.scanner_from_scan`; None if it says not."""
    told = layer.metadata.get("scanner_from_scan")
    # Others may use the word as well.
    numbers = isinstance(told, np.ndarray) and told.dtype.kind in "fiu"
    return told if numbers and turns_and_moves(told) else None


def was_turned(layer: Layer) -> bool | None:
    """Return `Scan.turned` of the file that a layer was read from; None where it is of no file."""
    told = layer.metadata.get("turned")
    # Others may use the word as well; their readers turn nothing.
    if isinstance(told, bool):
        return told
    return None if layer.source.path is None else False


def assumed_of(layer: Layer) -> tuple[str, ...]:
    """Return a sentence for each thing that the layer's file does not say and was assumed."""
    told = layer.metadata.get("assumed")
    # Others may use the word as well.
    return tuple(map(str, told)) if isinstance(told, tuple) else ()


def standing(layer: Layer, spacing: ArrayLike) -> Matrix:
    """Return the map from a session's world, mm, to napari's in mm as well.

    Parameters
    ----------
    layer : napari layer
        One of the session's, of any affine.
    spacing : (3,) array_like
        Voxel size of the session, mm z y x.

    Returns
    -------
    (4, 4) ndarray of float64
        Along axes whose unit is no length, pixels say, to that unit.
    """
    matrix = data_to_world(layer) @ voxel_from_world(spacing)
    matrix[:3] *= np.array([_millimetres(unit) for unit in layer.units])[:, None]
    return matrix


def spacing_of(layer: Layer) -> tuple[float, float, float]:
    """Read the voxel size of a layer of three dimensions or more from its transform.

    Returns
    -------
    (float, float, float)
        Millimetres, z y x. A world without a unit of length counts as millimetres.

    Notes
    -----
    Scale, affine and units together. Where the layer is sheared, as by the gantry of a CT
    scanner, it is the length of a pixel along x, the distance of rows, and the distance of
    slices: their product is a voxel's true volume.
    """
    units = [_millimetres(unit) for unit in layer.units[-3:]]
    edges = np.diag(units) @ data_to_world(layer)[:3, :3]
    # A QR decomposition of the edges, x first: on its diagonal stands what each edge adds at
    # right angles to those before it.
    lengths = np.abs(np.diag(np.linalg.qr(edges[:, ::-1], mode="r")))[::-1]
    # Products of affines leave 0.7999999999: twelve digits hide it and keep real differences.
    z, y, x = (float(f"{mm:.12g}") for mm in lengths)
    return (z, y, x)


def set_spacing(layer: Layer, spacing: ArrayLike) -> None:
    """Give a layer voxels of another size; what turns and shears it stays.

    What was assumed of that size is assumed no more, see `assumed_of`.

    Parameters
    ----------
    layer : napari layer
        Of three dimensions or more.
    spacing : (3,) array_like
        mm, z y x, as `spacing_of` reads it.
    """
    # What stands before the scale acts on lengths already made: their ratios are those of scales.
    ratios = np.asarray(spacing, dtype=np.float64) / spacing_of(layer)
    left = assumed_besides_size(assumed_of(layer))
    if left != assumed_of(layer):
        layer.metadata["assumed"] = left
    layer.scale = [*layer.scale[:-3], *layer.scale[-3:] * ratios]


def unit_of(layer: Layer) -> LengthUnit:
    """Return the unit a layer's lengths are told in: its own, where napari knows it.

    Returns
    -------
    LengthUnit
        µm for a layer in µm or finer units; mm for other units of length, and for numbers
        without a unit; voxels where there are no numbers either, only ones.
    """
    own = layer.units[-1]
    spacing = spacing_of(layer)
    if dict(own.dimensionality) != LENGTH:
        return LengthUnit.voxels(spacing) if equal_spacing(spacing, np.ones(3)) else MM
    # A micrometre is 0.001 mm but for rounding.
    return LengthUnit(MICRO, 1000.0) if _millimetres(own) < 0.0011 else MM


def _millimetres(unit: pint.Unit) -> float:
    if dict(unit.dimensionality) != LENGTH:
        return 1.0
    return float((1.0 * unit).to("millimeter").magnitude)


# What pint says of units of length.
LENGTH = {"[length]": 1.0}

# Of a voxel's edge: less than this is rounding in a product of affines.
SAME_SIZE = 1e-6


def equal_spacing(a: ArrayLike, b: ArrayLike) -> bool:
    """Return whether two voxel sizes are the same.

    Parameters
    ----------
    a, b : (3,) array_like
        mm, z y x.
    """
    return bool(np.allclose(a, b, rtol=SAME_SIZE, atol=0))


def voxel_at(
    layer: Layer, position: ArrayLike, units: Sequence[Any] | None = None
) -> NDArray[np.float64]:
    """Return the voxel z y x, with fractions, at a point of napari's world.

    Parameters
    ----------
    layer : napari layer
    position : (N,) array_like
        The last three axes count.
    units : sequence of pint.Unit, optional
        Of that world; by default the layer's own.
    """
    there = np.asarray(position, dtype=np.float64)[-3:]
    data_from_world: Matrix = np.linalg.inv(data_to_world(layer, units)).astype(np.float64)
    return transform_points(data_from_world, there)
