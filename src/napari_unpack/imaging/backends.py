"""Which of the two backends draws: the CPU's kernels or the graphics card's shaders."""

from __future__ import annotations

import importlib
from typing import Any

BACKENDS = ("auto", "cpu", "gl")


def counting(backend: str) -> Any:
    """Return the module that counts occlusion: the CPU's where GL has no counters (below 4.3)."""
    module = chosen(backend)
    if hasattr(module, "occlusion_counts"):
        return module
    return importlib.import_module("napari_unpack.raycasting")


def chosen(backend: str) -> Any:
    """Return the module that draws.

    Parameters
    ----------
    backend : {"auto", "cpu", "gl"}
        "auto" takes GL on graphics hardware, else the CPU: a software rasteriser is slower
        than our own kernels.

    Returns
    -------
    module
        `napari_unpack.raycasting`, or `napari_unpack.rendering.gl_backend` with functions of
        the same names, arguments and results.

    Raises
    ------
    ValueError
        If the backend is unknown, or "gl" where no GL context can be had.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {BACKENDS}, got {backend!r}")
    if backend == "cpu" or (backend == "auto" and not _hardware()):
        return importlib.import_module("napari_unpack.raycasting")
    if backend == "gl" and not _offscreen().available():
        raise ValueError('backend "gl" needs a GL context and none can be had here; use "cpu"')
    return importlib.import_module("napari_unpack.rendering.gl_backend")


def _offscreen() -> Any:
    return importlib.import_module("napari_unpack.rendering.offscreen")


def _hardware() -> bool:
    offscreen = _offscreen()
    return bool(offscreen.available() and not offscreen.is_software())
