"""What pictures ask of a session, and how they look at what they show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Surroundings
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering import TransferFunctionLike
from napari_unpack.rendering.object_casting import Appearance
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.rendering.subvolumes import CacheBook, Pictured, Subvolume
from napari_unpack.rendering.upsampling import look_at

LIGHT = Shading()

BOOK = CacheBook()
"""What was cast of every session, by what it depends on."""


class Scene(Pictured, Protocol):
    """What pictures ask of a session; `session.Session` is one."""

    @property
    def transfer_function(self) -> TransferFunctionLike:
        """Colour and opacity by density."""

    @property
    def states(self) -> Mapping[int, Any]:
        """`ObjectState` by ID."""

    @property
    def poses(self) -> Mapping[int, Pose]:
        """Poses of the unpacked objects, pivot space."""

    @property
    def flights(self) -> Mapping[int, Any]:
        """Flights in the air."""

    @property
    def clipping(self) -> NDArray[np.float64]:
        """(N, 2, 3) planes that cut what is packed, voxels."""

    @property
    def surroundings(self) -> Surroundings:
        """Background, box and scale bar."""

    def packed_tints(self) -> NDArray[np.float32]:
        """(M, 4) tints, zero but for what is packed."""

    def solo_tints(self, object_id: int) -> NDArray[np.float32]:
        """(M, 4) tints, zero but for one object."""

    def study(self, object_id: int) -> ObjectStyle:
        """Opacity and cut of an object's own."""

    def transfer_function_of(self, object_id: int) -> TransferFunctionLike:
        """What an object is shown with outside the bag."""


def packed_look(
    session: Scene, shading: Shading | None, step_scale: float, backend: str
) -> Appearance:
    """Return how what is packed is cast, but for the camera."""
    look = _look(session, session.packed_tints(), shading, step_scale, backend)
    return replace(look, clipping=session.clipping)


def solo_look(
    session: Scene,
    object_id: int,
    crop: Subvolume,
    shading: Shading | None,
    step_scale: float,
    backend: str,
) -> Appearance:
    """Return how one object's crop is cast, but for where it is and the camera."""
    look = _look(session, session.solo_tints(object_id), shading, step_scale, backend)
    function, cut = session.transfer_function_of(object_id), session.study(object_id)
    planes = cut.planes(crop.voxel_from_world)
    return look_at(crop, replace(look, transfer_function=function, clipping=planes))


def _look(
    session: Scene,
    tints: NDArray[np.float32],
    shading: Shading | None,
    step_scale: float,
    backend: str,
) -> Appearance:
    spacing = np.asarray(session.spacing, dtype=np.float64)
    return Appearance(session.transfer_function, tints, shading, spacing, step_scale, backend)
