"""The one door to both backends: pictures, ID layers, occlusion, picking.

Checks arguments, converts them, chooses a backend; computes nothing itself. Names are imported
on first use, so that a plugin starts without loading numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_unpack.imaging.casting import (
        TransferFunctionLike,
        cast_ids,
        cast_occlusion,
        cast_tinted,
        rays_for,
    )
    from napari_unpack.imaging.counting import occlusion, occlusion_ratios
    from napari_unpack.imaging.pictures import object_id_layers, pick, render

_HOMES = {
    "TransferFunctionLike": "casting",
    "cast_ids": "casting",
    "cast_occlusion": "casting",
    "cast_tinted": "casting",
    "interference_in": "interfering",
    "object_id_layers": "pictures",
    "occlusion": "counting",
    "occlusion_ratios": "counting",
    "pick": "pictures",
    "rays_for": "casting",
    "render": "pictures",
}

__all__ = [
    "TransferFunctionLike",
    "cast_ids",
    "cast_occlusion",
    "cast_tinted",
    "interference_in",
    "object_id_layers",
    "occlusion",
    "occlusion_ratios",
    "pick",
    "rays_for",
    "render",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
