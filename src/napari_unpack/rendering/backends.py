"""Which of the two backends draws: the CPU's kernels or the graphics card's shaders."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

BACKENDS = ("auto", "cpu", "gl")


def ask(backend: str, name: str, *arguments: Any, **keywords: Any) -> Any:
    """Have a backend compute; where "auto" took the graphics card and it fails, the CPU does.

    Parameters
    ----------
    backend : {"auto", "cpu", "gl"}
    name : str
        A function of `napari_unpack.rendering.cpu`; the CPU's is taken too where GL has none.
    *arguments, **keywords
        Of that function.

    Returns
    -------
    object
        What it returns.

    Warns
    -----
    RuntimeWarning
        If the driver refuses, with its log, in which our files and lines are named. It is not
        asked again in this process.
    """
    cpu = importlib.import_module("napari_unpack.rendering.cpu")
    module = chosen(backend)
    by_cpu = getattr(cpu, name)
    by_any = getattr(module, name, by_cpu)
    if backend != "auto" or by_any is by_cpu:
        return by_any(*arguments, **keywords)
    try:
        return by_any(*arguments, **keywords)
    except (ValueError, TypeError):
        # More than shaders take, which the CPU does; or wrong, which it says as well.
        return by_cpu(*arguments, **keywords)
    # Drivers refuse in every way there is: compiler logs, incomplete buffers, no memory.
    except Exception as error:
        _offscreen().give_up()
        warnings.warn(
            f"The graphics card cannot draw this ({error}); the processor does it from here on.",
            RuntimeWarning,
            stacklevel=3,
        )
    return by_cpu(*arguments, **keywords)


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
        `napari_unpack.rendering.cpu`, or `napari_unpack.rendering.gl.backend` with functions of
        the same names, arguments and results.

    Raises
    ------
    ValueError
        If the backend is unknown, or "gl" where no GL context can be had.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {BACKENDS}, got {backend!r}")
    if on_cpu(backend):
        return importlib.import_module("napari_unpack.rendering.cpu")
    if backend == "gl" and not _offscreen().available():
        raise ValueError('backend "gl" needs a GL context and none can be had here; use "cpu"')
    return importlib.import_module("napari_unpack.rendering.gl.backend")


def on_cpu(backend: str) -> bool:
    """Tell whether `chosen` is the CPU's."""
    return backend == "cpu" or (backend == "auto" and not _hardware())


def _offscreen() -> Any:
    return importlib.import_module("napari_unpack.rendering.gl.offscreen")


def _hardware() -> bool:
    return bool(_offscreen().hardware())
