"""Subvolumes: the box of an object or the whole volume, ready to be drawn, and their cache.

A flight draws one object some thirty times a second. Cutting its box out of the volume and making
its bricks cost more than the drawing itself, and depend on the volume and the labels alone.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.boxes import Box, LabelBoxes, box_corners, differing_box
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.geometry.transforms import translation
from napari_unpack.rendering.cpu import Bricks, relabelled
from napari_unpack.rendering.validation import checked_volume

Density = NDArray[np.uint16] | NDArray[np.float32]

# Voxels around an object's box: two of fringe, one for interpolation, one for the gradient.
MARGIN = 4
# Subvolumes and images kept for one session besides the whole volume.
MEGABYTES = 512


@dataclass(frozen=True, eq=False)
class Edit:
    """In what a subvolume differs from one before it: some labels.

    Parameters
    ----------
    of : weakref to Subvolume
        The one before.
    box : (slice, slice, slice) or None
        Voxels outside which the labels are the same; None where all are.
    """

    of: ReferenceType[Subvolume]
    box: Box | None


@dataclass(frozen=True, eq=False)
class Subvolume:
    """A box of a volume, ready to be cast.

    Parameters
    ----------
    volume : (z, y, x) ndarray of uint16 or float32
        C-contiguous density.
    labels : (z, y, x) ndarray of uint16
        C-contiguous display labels.
    bricks : Bricks
        Of both.
    voxel_from_world : (4, 4) ndarray of float64
        World mm to the subvolume's voxels.
    center : (3,) ndarray of float64
        Middle of the object's box, world mm: the point that a pose places.
    corners : (8, 3) ndarray of float64
        Around all that can be seen of it, world mm.
    edit : Edit, optional
        What it was made from, if it was not made from nothing.
    finer : (int, int, int)
        Into how many of its own a voxel of the volume was divided along z, y, x.
    """

    volume: Density
    labels: NDArray[np.uint16]
    bricks: Bricks
    voxel_from_world: Matrix
    center: Vector
    corners: NDArray[np.float64]
    edit: Edit | None = None
    finer: tuple[int, int, int] = (1, 1, 1)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        return self.volume.nbytes + self.labels.nbytes


class SubvolumeCache:
    """Subvolumes and images of a labelled volume; the least recently used is dropped first.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density, any real dtype.
    labels : (Z, Y, X) ndarray of uint16
        Display labels.
    boxes : LabelBoxes
        Of the objects, voxels.
    spacing : (3,) ndarray of float64, mm z y x
    """

    def __init__(
        self,
        volume: NDArray[np.generic],
        labels: NDArray[np.uint16],
        boxes: LabelBoxes,
        spacing: NDArray[np.float64],
    ) -> None:
        self.volume, self.labels = volume, labels
        self._spacing = np.asarray(spacing, dtype=np.float64)
        self._boxes = boxes
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._bytes = 0
        self._lock, self._whole_lock = Lock(), Lock()
        self._density: Density | None = None
        self._air: float | None = None
        self._whole: Subvolume | None = None
        self._whole_before: Subvolume | None = None

    def take_over(self, earlier: SubvolumeCache) -> None:
        """Keep what other labels leave as it is of a cache of the same volume."""
        self._density, self._air = earlier._density, earlier._air
        if np.array_equal(self._spacing, earlier._spacing):
            self._whole_before = earlier._whole or earlier._whole_before
        with earlier._lock:
            kept = list(earlier._kept.items())
        for key, made in kept:
            # Images depend on labels everywhere; only subvolumes can be compared cheaply.
            if not (isinstance(made, Subvolume) and isinstance(key, tuple) and key[0] == "object"):
                continue
            try:
                box = self._boxes.slices(key[1], MARGIN)
                middle = self._boxes.center(key[1], self._spacing)
            except KeyError:
                continue
            same = np.array_equal(middle, made.center)
            if same and np.array_equal(self.labels[box], made.labels):
                self.keep(key, lambda made=made: made)  # type: ignore[misc]

    def whole(self) -> Subvolume:
        """Return the whole volume; only bricks of changed labels are made anew."""
        # Two threads that asked at once would make it twice, the second from nothing.
        with self._whole_lock:
            before, self._whole_before = self._whole_before, None
            if self._whole is None and before is not None:
                labels = np.ascontiguousarray(self.labels)
                box = differing_box(before.labels, labels)
                bricks = before.bricks if box is None else relabelled(before.bricks, labels, box)
                edit = Edit(ref(before), box)
                self._whole = replace(before, labels=labels, bricks=bricks, edit=edit)
            if self._whole is None:
                shape = np.asarray(self.volume.shape)
                everything = tuple(slice(0, int(n)) for n in shape)
                middle = (shape - 1) / 2 * self._spacing
                self._whole = self._cut(everything, middle, 0 * shape, shape)
            return self._whole

    @property
    def air(self) -> float:
        """The lowest density of the volume."""
        if self._air is None:
            self._air = float(self._checked().min())
        return self._air

    def of_object(self, object_id: int) -> Subvolume:
        """Return an object's subvolume; raise `KeyError` where there is no such object."""

        def make() -> Subvolume:
            row = self._boxes.index(object_id)
            # Display labels reach two voxels beyond the object; see geometry.grow_labels.
            low = np.maximum(self._boxes.lower[row] - 2, 0)
            high = np.minimum(self._boxes.upper[row] + 2, self.volume.shape)
            middle = self._boxes.center(object_id, self._spacing)
            return self._cut(self._boxes.slices(object_id, MARGIN), middle, low, high)

        return self.keep(("object", object_id), make)

    def keep(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what is kept under a key, making it first where it is not.

        Parameters
        ----------
        key : hashable
            All that the thing depends on, but for volume and labels.
        make : callable
            Makes a thing with `nbytes`.
        """
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = make()
        with self._lock:
            if key not in self._kept:
                self._kept[key] = made
                self._bytes += made.nbytes
            # The one just made stays, however large: it is about to be used.
            while self._bytes > MEGABYTES * 2**20 and len(self._kept) > 1:
                _, dropped = self._kept.popitem(last=False)
                self._bytes -= dropped.nbytes
        return made

    def _cut(
        self,
        box: tuple[slice, ...],
        center: Vector,
        low: NDArray[np.int64],
        high: NDArray[np.int64],
    ) -> Subvolume:
        volume: Density = np.ascontiguousarray(self._checked()[box])  # type: ignore[assignment]
        labels = np.ascontiguousarray(self.labels[box])
        first = np.array([s.start for s in box], dtype=np.float64)
        return Subvolume(
            volume,
            labels,
            Bricks.of(labels, volume),
            translation(-first) @ voxel_from_world(self._spacing),
            center,
            box_corners(low.astype(float) - 0.5, high.astype(float) - 0.5) * self._spacing,
        )

    def _checked(self) -> Density:
        if self._density is None:
            self._density = checked_volume(self.volume, self.labels.shape)
        return self._density


class RenderCache:
    """What rendering keeps of one volume, under the labels it was made of.

    Notes
    -----
    Labels are known by the identity of their arrays, which no object writes to: an edit of labels
    makes another array.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._subvolumes: SubvolumeCache | None = None
        self._shown: tuple[NDArray[np.uint16], TransferFunction] | None = None
        self._functions: dict[int, TransferFunction] = {}

    def subvolumes(
        self,
        volume: NDArray[np.generic],
        labels: NDArray[np.uint16],
        boxes: LabelBoxes,
        spacing: NDArray[np.float64],
    ) -> SubvolumeCache:
        """Return the subvolumes of a volume with some labels; parameters as `SubvolumeCache`.

        Parameters
        ----------
        volume, labels, boxes, spacing
            As for `SubvolumeCache`.
        """
        with self._lock:
            known = self._subvolumes
            if known is not None and known.volume is volume and known.labels is labels:
                return known
            fresh = SubvolumeCache(volume, labels, boxes, spacing)
            if known is not None and known.volume is volume:
                fresh.take_over(known)
            self._subvolumes = fresh
            return fresh

    def transfer_functions(
        self, labels: NDArray[np.uint16], shown: TransferFunction
    ) -> dict[int, TransferFunction]:
        """Return a table by ID, to be filled, that is emptied for other arguments.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of uint16
        shown : TransferFunction
            The master's.
        """
        with self._lock:
            known = self._shown
            if known is None or known[0] is not labels or known[1] != shown:
                self._shown, self._functions = (labels, shown), {}
            return self._functions
