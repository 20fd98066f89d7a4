"""See into packed things: segment, colour and virtually unpack a CT volume.

The public API of the project. Names are imported on first use, so that napari can read the
plugin's manifest, and `import napari_unpack` return, without loading numba or scipy.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "simulate_bag": "napari_unpack.simulation",
    "segment": "napari_unpack.segmentation",
    "score": "napari_unpack.segmentation",
    "Oracle": "napari_unpack.segmentation",
    "train": "napari_unpack.segmentation",
    "score_by": "napari_unpack.segmentation",
    "score_objects": "napari_unpack.segmentation",
    "View": "napari_unpack.geometry.view",
    "TransferFunction": "napari_unpack.appearance",
    "interference": "napari_unpack.appearance",
    "assign_hues": "napari_unpack.appearance",
    "object_id_layers": "napari_unpack.imaging",
    "occlusion_ratios": "napari_unpack.imaging",
    "render": "napari_unpack.imaging",
    "pick": "napari_unpack.imaging",
    "Session": "napari_unpack.session",
    "movie": "napari_unpack.io",
    "open_session": "napari_unpack.io",
    "save_session": "napari_unpack.io",
}

__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
