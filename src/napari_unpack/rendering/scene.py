"""What an image shows, as frozen data: rendering draws a `Scene` and knows no session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Decorations, TransferFunction
from napari_unpack.appearance.minimum_opacity import visible_alone
from napari_unpack.appearance.tints import Mode, Rgba, legible_tint, packed_tints
from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering.object_casting import Appearance
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.rendering.rulers import Ruler
from napari_unpack.rendering.subvolumes import RenderCache, Subvolume, SubvolumeCache
from napari_unpack.rendering.upsampling import appearance_at
from napari_unpack.unpacking import Flight

# The light of every image of a scene.
LIGHT = Shading()

_MASTER_STYLE = ObjectStyle()


class Labels(Protocol):
    """Labels with what is derived from them; `session.labels.LabelData` is one."""

    @property
    def labels(self) -> NDArray[np.uint16]:
        """(Z, Y, X) object IDs."""

    @property
    def display(self) -> NDArray[np.uint16]:
        """(Z, Y, X) object IDs, grown into the fringe around objects."""

    @property
    def boxes(self) -> LabelBoxes:
        """Boxes of the objects, voxels."""


@dataclass(frozen=True)
class SceneDifference:
    """What the image of the packed bag must follow.

    Parameters
    ----------
    labels : bool
        The label volume is another.
    appearance : bool
        Densities look different, or are cut otherwise: every pixel may change.
    tints : bool
        Hues are others, or become tints in another way.
    ids : frozenset of int
        Objects that have left the bag or come back: pixels outside their boxes stay.
    """

    labels: bool = False
    appearance: bool = False
    tints: bool = False
    ids: frozenset[int] = frozenset()

    def __bool__(self) -> bool:
        return self.labels or self.appearance or self.tints or bool(self.ids)


@dataclass(frozen=True, eq=False)
class Scene:
    """All that an image needs but the camera; `Session.scene` makes one.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density, any real dtype.
    label_data : Labels
        Object IDs of the same shape.
    spacing : (3,) ndarray of float64, mm z y x
    transfer_function : TransferFunction
        The master's: colour and opacity by density.
    packed : frozenset of int
        Objects in the bag and in sight.
    inspected : tuple of int
        Objects shown alone.
    flights : mapping of int to Flight
        Flights in the air.
    poses : mapping of int to Pose
        Of the unpacked objects that are in sight and not in the air, pivot space.
    hues : mapping of int to float
        Hue in [0, 1) by ID.
    colors : mapping of int to (float, float, float, float)
        Straight RGBA of the objects that a person gave a colour, in place of their hue's.
    tint_mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    show_unlabelled : bool
        Whether matter without a label is visible.
    styles : mapping of int to ObjectStyle
        Of the objects that have an opacity or a cut of their own.
    mean_densities : mapping of int to float
        By ID; NaN where a density is not known.
    clipping : (N, 2, 3) ndarray of float64
        Planes (point, normal) that cut what is packed, voxels z y x.
    decorations : Decorations
        Background, box and scale bar.
    rulers : tuple of Ruler
        What was measured and is shown.
    largest_id : int
        Of the tables by ID; at least the largest of the labels.
    cache : RenderCache
        Shared by all scenes of one volume, so that nothing is cast or cut out twice.

    Notes
    -----
    To make a scene is cheap: display labels and tables of tints are made when they are first
    asked for, by whichever thread asks.
    """

    volume: NDArray[np.generic]
    label_data: Labels
    spacing: NDArray[np.float64]
    transfer_function: TransferFunction
    packed: frozenset[int] = frozenset()
    inspected: tuple[int, ...] = ()
    flights: Mapping[int, Flight] = field(default_factory=dict)
    poses: Mapping[int, Pose] = field(default_factory=dict)
    hues: Mapping[int, float] = field(default_factory=dict)
    colors: Mapping[int, Rgba] = field(default_factory=dict)
    tint_mode: Mode = "perceptual"
    show_unlabelled: bool = False
    styles: Mapping[int, ObjectStyle] = field(default_factory=dict)
    mean_densities: Mapping[int, float] = field(default_factory=dict)
    clipping: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2, 3)))
    decorations: Decorations = field(default_factory=Decorations.of)
    rulers: tuple[Ruler, ...] = ()
    largest_id: int = 0
    cache: RenderCache = field(default_factory=RenderCache)

    @property
    def labels(self) -> NDArray[np.uint16]:
        """(Z, Y, X) object IDs as images show them, grown into the fringe around objects."""
        return self.label_data.display

    @property
    def boxes(self) -> LabelBoxes:
        """Boxes of the objects, voxels."""
        return self.label_data.boxes

    @property
    def subvolumes(self) -> SubvolumeCache:
        """What was cut out of this volume with these labels, and drawn of it."""
        return self.cache.subvolumes(self.volume, self.labels, self.boxes, self.spacing)

    @cached_property
    def packed_tints(self) -> NDArray[np.float32]:
        """(M, 4) float32 tints, zero but for what is packed; read-only."""
        # Sorted, so that equal sets give equal tables whatever their history.
        shown = {i: self.hues[i] for i in sorted(self.packed)}
        return packed_tints(shown, self._max_id, self.tint_mode, self.show_unlabelled, self.colors)

    def tint_alone(self, object_id: int) -> NDArray[np.float32]:
        """Return the (4,) float32 tint of an object shown alone; its alpha may be above 1."""
        known = self._tints_alone.get(object_id)
        if known is None:
            opacity = None
            # With an opacity of its own a person has decided how it looks: nothing is made legible.
            if self.style(object_id).transfer_function is None:
                density = self.mean_densities[object_id]
                # Of NaN alone it is not known, and the least opacity has to do.
                if np.isfinite(density):
                    opacity = float(self.transfer_function.opacity_at(density))
            own = self.colors.get(object_id)
            known = legible_tint(self.hues[object_id], self.tint_mode, opacity, own)
            self._tints_alone[object_id] = known
        return known

    def tints_alone(self, object_id: int) -> NDArray[np.float32]:
        """Return (M, 4) float32 tints, zero but for one object."""
        table = np.zeros((self._max_id + 1, 4), np.float32)
        table[object_id] = self.tint_alone(object_id)
        return table

    def style(self, object_id: int) -> ObjectStyle:
        """Return the opacity and the cut that an object has of its own."""
        return self.styles.get(object_id, _MASTER_STYLE)

    def transfer_function_of(self, object_id: int) -> TransferFunction:
        """Return the transfer function of an object outside the bag.

        Its own, or the master's; with a minimum opacity where that hardly shows the object.
        """
        own = self.style(object_id).transfer_function
        if own is not None:
            return own
        known = self.cache.transfer_functions(self.label_data.labels, self.transfer_function)
        if object_id not in known:
            known[object_id] = visible_alone(
                object_id,
                self.label_data.labels,
                self.volume,
                self.boxes,
                self.mean_densities[object_id],
                self.transfer_function,
            )
        return known[object_id]

    def difference(self, shown: Scene) -> SceneDifference:
        """Return what differs for the packed bag from a scene that is shown."""
        # By content: arrays of the same planes may be different objects.
        cut = not np.array_equal(self.clipping, shown.clipping)
        return SceneDifference(
            # By identity of the boxes: an edit makes others, and comparing voxels would take long;
            # a copy of the same labels, kept from the user's brush, is no difference.
            labels=self.boxes is not shown.boxes,
            appearance=cut
            or self.transfer_function != shown.transfer_function
            or self.show_unlabelled != shown.show_unlabelled,
            tints=self.hues != shown.hues
            or self.colors != shown.colors
            or self.tint_mode != shown.tint_mode,
            ids=self.packed ^ shown.packed,
        )

    @cached_property
    def _tints_alone(self) -> dict[int, NDArray[np.float32]]:
        return {}

    @property
    def _max_id(self) -> int:
        return max(self.largest_id, int(self.boxes.ids[-1]))


def packed_appearance(scene: Scene, step_scale: float, backend: str) -> Appearance:
    """Return how the packed bag is drawn, but for the camera.

    Parameters
    ----------
    scene : Scene
    step_scale : float
        Distance of samples in the smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
    """
    return Appearance(
        scene.transfer_function,
        scene.packed_tints,
        LIGHT,
        scene.spacing,
        step_scale,
        backend,
        scene.clipping,
    )


def appearance_alone(
    scene: Scene, object_id: int, subvolume: Subvolume, step_scale: float, backend: str
) -> Appearance:
    """Return how one object is drawn outside the bag, but for its pose and the camera.

    Parameters
    ----------
    scene : Scene
    object_id : int
    subvolume : Subvolume
    step_scale : float
        Distance of samples in the smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
    """
    appearance = Appearance(
        scene.transfer_function_of(object_id),
        scene.tints_alone(object_id),
        LIGHT,
        scene.spacing,
        step_scale,
        backend,
        scene.style(object_id).planes(subvolume.voxel_from_world),
    )
    return appearance_at(subvolume, appearance)
