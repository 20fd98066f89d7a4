"""Files: volumes of many formats, tables, pictures and films.

Names are imported on first use, so that napari can ask for a reader without loading numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_unpack.io.films import movie
    from napari_unpack.io.images import save_png
    from napari_unpack.io.pages import save_objects_page
    from napari_unpack.io.scan import Scan
    from napari_unpack.io.sessions import open_session, save_session
    from napari_unpack.io.tables import save_objects_csv
    from napari_unpack.io.volumes import load_labels, load_volume, save_scan

_HOMES = {
    "Scan": "scan",
    "load_labels": "volumes",
    "load_volume": "volumes",
    "movie": "films",
    "open_session": "sessions",
    "save_objects_csv": "tables",
    "save_objects_page": "pages",
    "save_png": "images",
    "save_scan": "volumes",
    "save_session": "sessions",
}

__all__ = [
    "Scan",
    "load_labels",
    "load_volume",
    "movie",
    "open_session",
    "save_objects_csv",
    "save_objects_page",
    "save_png",
    "save_scan",
    "save_session",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
