"""What casting an object again and again needs, made once: its crop, its bricks, its pictures.

A flight casts one object some thirty times a second. Cutting its box out of the volume and
looking over its bricks cost more than the cast itself, and depend on the volume and the labels
alone.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, Protocol
from weakref import ReferenceType, WeakKeyDictionary, ref

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.boxes import Box, LabelBoxes, box_corners, differing_box
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.geometry.transforms import translation
from napari_unpack.rendering.cpu import Bricks, relabelled
from napari_unpack.rendering.validation import checked_volume

Density = NDArray[np.uint16] | NDArray[np.float32]

MARGIN = 4
"""Voxels around an object's box: two of fringe (geometry.halo), one for interpolation, one for
the gradient."""

MEGABYTES = 512
"""Crops and pictures kept for one session."""


class Pictured(Protocol):
    """What pictures ask of a session for its volume; see `session.Session`."""

    @property
    def volume(self) -> NDArray[Any]:
        """(Z, Y, X) density, any real dtype."""

    @property
    def display_labels(self) -> NDArray[np.uint16]:
        """(Z, Y, X) uint16 object IDs, grown into the fringe."""

    @property
    def boxes(self) -> LabelBoxes:
        """Boxes of the objects, voxels."""

    @property
    def spacing(self) -> NDArray[np.float64]:
        """(3,) voxel size, mm."""


@dataclass(frozen=True, eq=False)
class Edit:
    """In what a crop differs from one before it: some labels.

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
        World mm to the crop's voxels.
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
    """Crops and pictures of one session, the least recently used thrown away first.

    Parameters
    ----------
    session : Pictured
        Only its arrays are kept, not itself.
    megabytes : int
        What may be kept besides the whole volume.
    """

    def __init__(self, session: Pictured, megabytes: int = MEGABYTES) -> None:
        self.volume, self.labels = session.volume, session.display_labels
        self._spacing = np.asarray(session.spacing, dtype=np.float64)
        self._boxes = session.boxes
        self._limit = megabytes * 2**20
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()
        self._density: Density | None = None
        self._air: float | None = None
        self._whole: Subvolume | None = None
        self._whole_before: Subvolume | None = None

    def taking_over(self, earlier: SubvolumeCache) -> SubvolumeCache:
        """Keep what other labels leave as it is of a cache of the same volume; return self."""
        self._density, self._air = earlier._density, earlier._air
        if np.array_equal(self._spacing, earlier._spacing):
            self._whole_before = earlier._whole or earlier._whole_before
        with earlier._lock:
            kept = list(earlier._kept.items())
        for key, made in kept:
            if not (isinstance(made, Subvolume) and isinstance(key, tuple) and key[0] == "crop"):
                continue
            try:
                box = self._boxes.slices(key[1], MARGIN)
                middle = self._boxes.center(key[1], self._spacing)
            except KeyError:
                continue
            same = np.array_equal(middle, made.center)
            if same and np.array_equal(self.labels[box], made.labels):
                self.keep(key, lambda made=made: made)  # type: ignore[misc]
        return self

    def whole(self) -> Subvolume:
        """Return the whole volume as a crop; only bricks of changed labels are made anew."""
        before, self._whole_before = self._whole_before, None
        if self._whole is None and before is not None:
            labels = np.ascontiguousarray(self.labels)
            box = differing_box(before.labels, labels)
            bricks = before.bricks if box is None else relabelled(before.bricks, labels, box)
            self._whole = replace(before, labels=labels, bricks=bricks, edit=Edit(ref(before), box))
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

    def crop(self, object_id: int) -> Subvolume:
        """Return an object's crop; raise `KeyError` where there is no such object."""

        def make() -> Subvolume:
            row = self._boxes.index(object_id)
            low = np.maximum(self._boxes.lower[row] - 2, 0)
            high = np.minimum(self._boxes.upper[row] + 2, self.volume.shape)
            middle = self._boxes.center(object_id, self._spacing)
            return self._cut(self._boxes.slices(object_id, MARGIN), middle, low, high)

        return self.keep(("crop", object_id), make)

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
            while self._bytes > self._limit and len(self._kept) > 1:
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


@dataclass(frozen=True)
class CacheBook:
    """The cache of every living session, begun anew when its volume or labels are exchanged."""

    _caches: WeakKeyDictionary[Any, SubvolumeCache] = field(default_factory=WeakKeyDictionary)

    def of(self, session: Pictured) -> SubvolumeCache:
        """Return a session's cache."""
        cache = self._caches.get(session)
        if cache is None or cache.volume is not session.volume:
            cache = self._caches[session] = SubvolumeCache(session)
        elif cache.labels is not session.display_labels:
            cache = self._caches[session] = SubvolumeCache(session).taking_over(cache)
        return cache
