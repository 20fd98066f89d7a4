"""Layers of the viewer to choose from, and what is read from a chosen one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from napari.layers import Labels, Layer
from numpy.typing import NDArray
from qtpy.QtCore import Signal

from napari_unpack.layers.compat import unwrap
from napari_unpack.layers.levels import Factors, factors_of, finest_fitting
from napari_unpack.layers.placement import FIELDS, spacing_of
from napari_unpack.memory import total_memory
from napari_unpack.viewer.plain_text import literal
from napari_unpack.widgets.narrow import Choice

if TYPE_CHECKING:
    import napari
    from napari.utils.events import Event


class LayerInput(Choice):
    """A drop-down list of the viewer's layers that keeps itself up to date.

    `chosen` is emitted when the chosen layer changes, by hand or because layers came and went;
    `listed` when layers are listed anew, also because one has another name, size or place.

    Parameters
    ----------
    viewer : napari.Viewer
    accepts : callable
        Takes a layer and returns whether to list it.
    none : str, optional
        Text of a first entry that means no layer.
    prefers : callable, optional
        Takes a layer and returns whether to choose it before others.
    refusal : callable, optional
        Takes a listed layer and returns why it cannot be chosen, in a few words; "" where it can.
    """

    chosen = Signal()
    listed = Signal()

    def __init__(
        self,
        viewer: napari.Viewer,
        accepts: Callable[[Layer], bool],
        none: str | None = None,
        prefers: Callable[[Layer], bool] | None = None,
        refusal: Callable[[Layer], str] | None = None,
    ) -> None:
        super().__init__()
        self._viewer = viewer
        self._accepts = accepts
        self._none = none
        self._prefers = prefers
        self._refusal = refusal
        self._refused: dict[Layer, str] = {}
        self._layers: list[Layer] = []
        events = viewer.layers.events
        for event in (events.inserted, events.removed, events.reordered):
            event.connect(self._relist)
        self.currentIndexChanged.connect(lambda _: self.chosen.emit())
        self.refresh()

    @property
    def layer(self) -> Layer | None:
        """The chosen layer, or None."""
        index = self.currentIndex() - (self._none is not None)
        return self._layers[index] if 0 <= index < len(self._layers) else None

    def choose(self, layer: Layer | None) -> None:
        """Choose a listed layer; one that cannot be chosen, or None, means the first that can."""
        able = [each for each in self._layers if each not in self._refused]
        first = None if self._none is not None else next(iter(able), None)
        wanted = layer if layer in able else first
        if wanted is not None:
            self.setCurrentIndex(self._layers.index(wanted) + (self._none is not None))
        else:
            # -1 is how Qt says that nothing is chosen.
            self.setCurrentIndex(-1 if self._none is None else 0)

    def _relist(self, _event: Event) -> None:
        # Opening and closing a session moves a dozen layers that are none of these.
        if self._accepted() != self._layers:
            self.refresh()

    def _accepted(self) -> list[Layer]:
        return [unwrap(layer) for layer in self._viewer.layers if self._accepts(layer)]

    def refresh(self, _event: Event | None = None) -> None:
        """List the viewer's layers anew, keeping the choice where it is still there."""
        kept = self.layer
        self._unlink()
        self._layers = self._accepted()
        reasons = {} if self._refusal is None else {x: self._refusal(x) for x in self._layers}
        self._refused = {layer: why for layer, why in reasons.items() if why}
        blocked = self.blockSignals(True)
        self._fill()
        self.choose(kept if kept in self._layers else self._first_choice())
        self.blockSignals(blocked)
        for event in self._followed():
            event.connect(self.refresh)
        # Also where the chosen layer was removed.
        if self.layer is not kept:
            self.chosen.emit()
        self.listed.emit()

    def _fill(self) -> None:
        self.clear()
        if self._none is not None:
            self.addItem(self._none)
        for layer in self._layers:
            why = self._refused.get(layer, "")
            self.addItem(f"{layer.name} ({why})" if why else str(layer.name))
            item = self.model().item(self.count() - 1)
            item.setEnabled(not why)
            item.setToolTip(literal(f"{layer.name}: {why}." if why else str(layer.name)))

    def _first_choice(self) -> Layer | None:
        if self._none is not None or self._prefers is None:
            return None
        able = (layer for layer in self._layers if layer not in self._refused)
        return next(filter(self._prefers, able), None)

    def close_links(self) -> None:
        """Stop listening to the viewer."""
        self._unlink()
        events = self._viewer.layers.events
        for event in (events.inserted, events.removed, events.reordered):
            event.disconnect(self._relist)

    def _unlink(self) -> None:
        for event in self._followed():
            event.disconnect(self.refresh)

    def _followed(self) -> list[Any]:
        # Names and reasons are shown; other data may have another shape.
        told = ("name", "data", *FIELDS)
        return [layer.events[name] for layer in self._layers for name in told]


def is_users(layer: Layer) -> bool:
    """Return whether a layer is the user's own, and not one of the plugin's."""
    # By module, since importing our layers here would load the renderers with the window.
    return not type(unwrap(layer)).__module__.startswith("napari_unpack")


# Density of water, HU + 1000.
WATER = 1000

# Density of labels without an image where they touch: light comes from the slope of densities, and
# without one there two objects that touch are one flat surface.
GROOVE = 600

# Of a voxel, beside the volume: int32 labels of the layer, of the session, and to work with.
LABEL_BYTES = 12

# Share of the memory that volume and labels may fill; napari and the system need the rest.
USABLE_MEMORY = 0.7

# What napari layers hold: a NumPy, dask or zarr array, with `shape` and `dtype` and slicing.
LazyArray: TypeAlias = Any


@dataclass(frozen=True, eq=False)
class Volume:
    """A density volume taken from an Image layer, or from labels that have none.

    Parameters
    ----------
    data : (Z, Y, X) array
        As the layer holds it; lazy arrays stay lazy.
    spacing : (float, float, float)
        Voxel size in mm, z y x.
    name : str
        The layer's name.
    labelled : bool
        Whether the data are labels, which `in_memory` makes densities of.
    whole : array, optional
        The volume at full resolution, where `data` is a coarser level of it: all of it fits no
        memory.
    factors : (int, int, int)
        Voxels of `whole` to one of `data`, z y x.
    """

    data: LazyArray
    spacing: tuple[float, float, float]
    name: str
    labelled: bool = False
    whole: LazyArray | None = None
    factors: Factors = (1, 1, 1)

    @property
    def whole_spacing(self) -> tuple[float, float, float]:
        """Voxel size of `whole` in mm, z y x."""
        z, y, x = (mm / f for mm, f in zip(self.spacing, self.factors, strict=True))
        return z, y, x


def shape_of(layer: Layer) -> tuple[int, ...]:
    """Return the shape of a layer's data at its finest, without colours; reads no voxels."""
    shape = np.shape(_level(layer))
    return shape[:-1] if getattr(layer, "rgb", False) else shape


def refusal_of(layer: Layer) -> str:
    """Return in a few words why a layer is no volume, "" where it is one."""
    shape = shape_of(layer)
    if len(shape) < 3:
        return f"{len(shape)}D"
    return "no voxels" if 0 in shape else ""


def volume_of(layer: Layer, index: Sequence[int] = ()) -> Volume:
    """Take the density volume out of an Image layer.

    Parameters
    ----------
    layer : napari.layers.Image or napari.layers.Labels
        Of a multiscale layer the finest level is taken that fits the memory.
    index : sequence of int, optional
        One for each of `extra_axes(layer)`; by default the first of all.

    Raises
    ------
    ValueError
        If the layer is no volume, or has no voxels.
    """
    shape = shape_of(layer)
    extent = " x ".join(map(str, shape))
    if len(shape) < 3:
        raise ValueError(f"'{layer.name}' is {len(shape)}D ({extent}): choose a 3D volume")
    if 0 in shape:
        raise ValueError(f"'{layer.name}' has no voxels ({extent}): choose another volume")
    levels = [_at(layer, index, level) for level in range(_level_count(layer))]
    words = [axis.words(i) for axis, i in zip(extra_axes(layer), index, strict=False)]
    level = _fitting(levels)
    words += [f"level {level}"] if level else []
    name = f"{layer.name} ({', '.join(words)})" if words else str(layer.name)
    spacing, labelled = spacing_of(layer), isinstance(layer, Labels)
    if not level:
        return Volume(levels[0], spacing, name, labelled)
    factors = factors_of(levels[0].shape, levels[level].shape)
    z, y, x = (mm * f for mm, f in zip(spacing, factors, strict=True))
    return Volume(levels[level], (z, y, x), name, labelled, levels[0], factors)


def _fitting(levels: Sequence[LazyArray]) -> int:
    """Return which level is unpacked: the finest that fits, the coarsest where none does."""
    if isinstance(levels[0], np.ndarray):
        return 0
    voxel = np.dtype(levels[0].dtype).itemsize + LABEL_BYTES
    return finest_fitting([level.shape for level in levels], voxel, USABLE_MEMORY * total_memory())


def _level_count(layer: Layer) -> int:
    return len(layer.data) if layer.multiscale else 1


@dataclass(frozen=True)
class ExtraAxis:
    """An axis of a layer beside z, y and x: one volume for each index.

    Parameters
    ----------
    title : str
        As people call it, in a word.
    size : int
    step : int or None
        Which axis of the viewer it is; None for colours, which have none.
    choices : tuple of str
        What its indices are called, where they have names.
    """

    title: str
    size: int
    step: int | None
    choices: tuple[str, ...] = ()

    def words(self, index: int) -> str:
        """Say which one it is."""
        which = "time point" if self.title == TIME else self.title.lower()
        return self.choices[index] if self.choices else f"{which} {index}"


# What files call these axes.
TIME = "Time"
TITLES = {"t": TIME, "time": TIME, "c": "Channel", "channel": "Channel"}
COLORS = ("Red", "Green", "Blue", "Opacity")


def extra_axes(layer: Layer) -> tuple[ExtraAxis, ...]:
    """Return the axes of a layer beside its last three, then its colours; reads no voxels."""
    shape, labels = shape_of(layer), [str(each) for each in layer.axis_labels]
    # napari names axes without a name -1, -2 and so on; its sliders count them from 0.
    names = [f"Axis {k}" if name.lstrip("-").isdigit() else name for k, name in enumerate(labels)]
    axes = [
        ExtraAxis(TITLES.get(name.lower(), name), size, k - len(shape))
        for k, (name, size) in enumerate(zip(names[:-3], shape[:-3], strict=True))
    ]
    if getattr(layer, "rgb", False):
        count = int(_level(layer).shape[-1])
        axes.append(ExtraAxis("Colour", count, None, COLORS[:count]))
    return tuple(axes)


def _level(layer: Layer, level: int = 0) -> LazyArray:
    return layer.data[level] if layer.multiscale else layer.data


def _at(layer: Layer, index: Sequence[int], level: int = 0) -> LazyArray:
    """Return the three-dimensional part of a layer's level; lazy arrays stay lazy."""
    axes = extra_axes(layer)
    where = [*index, *[0] * (len(axes) - len(index))]
    steps = [i for axis, i in zip(axes, where, strict=True) if axis.step is not None]
    data = _level(layer, level)
    data = data[tuple(steps)] if steps else data
    return data[..., where[-1]] if axes and axes[-1].step is None else data


def in_memory(volume: Volume) -> NDArray[Any]:
    """Read a volume that may still be on disk; labelled voxels count as water.

    Raises
    ------
    ValueError
        If volume and labels would fill most of the memory: both are shown whole.
    """
    data = _read(volume)
    return _as_water(data) if volume.labelled else data


def _read(volume: Volume) -> NDArray[Any]:
    data = volume.data
    # In memory already: nothing can be refused any more.
    if isinstance(data, np.ndarray):
        return data
    voxels = float(np.prod([float(n) for n in data.shape]))
    room = total_memory()
    needed = voxels * (np.dtype(data.dtype).itemsize + LABEL_BYTES)
    if needed > USABLE_MEMORY * room:
        extent = " x ".join(map(str, data.shape))
        raise ValueError(
            f"'{volume.name}' ({extent}) needs about {needed / 1e9:.0f} GB to be unpacked, and "
            f"this computer has {room / 1e9:.0f} GB: crop it or take every second voxel first; "
            "napari_unpack.segment(data, spacing, out=...) finds the objects of the whole"
        )
    return np.asarray(data)


def _as_water(labels: NDArray[Any]) -> NDArray[np.uint16]:
    """Return densities that show labels: water, and a groove where two of them touch."""
    density = np.where(labels != 0, np.uint16(WATER), np.uint16(0))
    for axis in range(labels.ndim):
        low, high = (
            tuple(slice(*ends) if k == axis else slice(None) for k in range(labels.ndim))
            for ends in ((None, -1), (1, None))
        )
        touching = (labels[low] != labels[high]) & (labels[low] != 0) & (labels[high] != 0)
        density[low][touching] = density[high][touching] = GROOVE
    return density


def labels_of(layer: Labels, volume: Volume, index: Sequence[int] = ()) -> LazyArray:
    """Take the label volume that belongs to a density volume.

    Parameters
    ----------
    layer : napari.layers.Labels
    volume : Volume
        The labels must have its shape.
    index : sequence of int, optional
        That of the volume; labels without more axes hold for every index.

    Returns
    -------
    (Z, Y, X) array of int
        Object IDs as the layer holds them.

    Raises
    ------
    ValueError
        If the shapes differ, those of all levels.
    """
    own = index[: len(extra_axes(layer))]
    levels = [_at(layer, own, level) for level in range(_level_count(layer))]
    for level in levels:
        if tuple(level.shape) == tuple(volume.data.shape):
            return level
    given, wanted = (" x ".join(map(str, a.shape)) for a in (levels[0], volume.data))
    raise ValueError(
        f"labels '{layer.name}' are {given} but '{volume.name}' is {wanted}: "
        "choose labels made from this volume"
    )


def whole_labels_of(layer: Labels, volume: Volume, index: Sequence[int] = ()) -> LazyArray | None:
    """Take the labels of a volume at full resolution, where that is a level of a larger one.

    Parameters
    ----------
    layer, volume, index
        As for `labels_of`.

    Returns
    -------
    (Z, Y, X) array of int or None
        None where the volume is whole, or the layer has no labels of its finest level.
    """
    finest = _at(layer, index[: len(extra_axes(layer))])
    if volume.whole is None or tuple(finest.shape) != tuple(volume.whole.shape):
        return None
    return finest


def names_of(layer: Labels) -> dict[int, str]:
    """Read the names of objects that a Labels layer carries.

    Returns
    -------
    dict of int to str
        By ID, from the columns `index` and `name` of its `features`; empty without them.
    """
    features = layer.features
    if not {"index", "name"} <= set(features.columns):
        return {}
    # A table made by hand has rows of no object.
    told = features.dropna(subset=["index"])
    pairs = zip(told["index"], told["name"], strict=True)
    return {int(i): name for i, name in pairs if isinstance(name, str) and name}


def misfit(image: Layer, labels: Layer) -> str:
    """Return in a few words why labels cannot belong to an image, "" where they may.

    Parameters
    ----------
    image, labels : napari.layers.Layer
        No voxels are read.
    """
    theirs, wanted = shape_of(labels), shape_of(image)
    # Labels of one time point may belong to every one.
    if theirs in (wanted, wanted[-3:]):
        return ""
    given, needed = (" x ".join(map(str, shape)) for shape in (theirs, wanted[-len(theirs) :]))
    return f"{given}, not {needed}"
