"""The two backends that draw and count rays, one protocol: numba kernels, or shaders."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeVar

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import Shading

if TYPE_CHECKING:
    from napari_unpack.rendering.cpu import Bricks

BACKENDS = ("auto", "cpu", "gl")

T = TypeVar("T")


def checked_backend(backend: str) -> str:
    """Return what casts rays.

    Raises
    ------
    ValueError
        If there is no such backend.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {', '.join(BACKENDS)}, got {backend!r}")
    return backend


class RenderBackend(Protocol):
    """What a backend computes; the modules `rendering.cpu` and `rendering.gl.backend` do.

    Notes
    -----
    Both give the same results: object IDs, counts and interference exactly, colours within
    2/255 (tests/rendering/gl). Docstrings of the parameters stand at `rendering.cpu`.
    """

    def id_layers(
        self,
        labels: NDArray[np.uint16],
        rays: Rays,
        visible: NDArray[np.bool_],
        layers: int = 1,
        bricks: Bricks | None = None,
        clipping: ArrayLike | None = None,
    ) -> NDArray[np.int32]:
        """Return the (layers, H, W) distinct visible objects on every ray, nearest first.

        Parameters
        ----------
        labels, rays, visible, layers, bricks, clipping
            See `rendering.cpu.id_layers`.
        """

    def occlusion_counts(
        self,
        labels: NDArray[np.uint16],
        rays: Rays,
        visible: NDArray[np.bool_],
        bricks: Bricks | None = None,
    ) -> OcclusionCounts:
        """Return how much of every object is hidden by others.

        Parameters
        ----------
        labels, rays, visible, bricks
            See `rendering.cpu.occlusion_counts`.
        """

    def tinted(
        self,
        volume: NDArray[np.uint16] | NDArray[np.float32],
        labels: NDArray[np.uint16],
        rays: Rays,
        spacing: ArrayLike,
        table: NDArray[np.float32],
        domain: tuple[float, float],
        tints: NDArray[np.float32],
        shading: Shading | None,
        bricks: Bricks | None = None,
        jitter: bool = False,
        clipping: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the premultiplied (H, W, 4) image and its (H, W) depth in mm.

        Parameters
        ----------
        volume, labels, rays, spacing, table, domain, tints, shading, bricks, jitter, clipping
            See `rendering.cpu.tinted`.
        """

    def interference(self, ids: NDArray[np.integer], distance: float = 5) -> nx.Graph:
        """Return which objects of (layers, H, W) object-ID layers come near one another.

        Parameters
        ----------
        ids, distance
            See `appearance.interference`.
        """


class Driver(Protocol):
    """What is known of the offscreen GL driver; the module `rendering.gl.offscreen`."""

    def available(self) -> bool:
        """Whether this thread can draw offscreen."""

    def unavailable_because(self) -> str | None:
        """Return why it cannot, None where it can."""

    def hardware(self) -> bool:
        """Whether a graphics card draws, and has not failed yet."""

    def give_up(self) -> None:
        """Take note that the driver refuses to draw."""


def with_backend(backend: str, compute: Callable[[RenderBackend], T]) -> T:
    """Compute on a backend; where "auto" took the graphics card and it fails, on the CPU.

    Parameters
    ----------
    backend : {"auto", "cpu", "gl"}
    compute : callable
        Given a RenderBackend, returns the result.

    Raises
    ------
    ValueError
        If the backend is unknown, or "gl" where no GL context can be had.

    Warns
    -----
    RuntimeWarning
        If the driver refuses, with its log, in which our files and lines are named. It is not
        asked again in this process.
    """
    drawing = chosen(backend)
    if backend != "auto" or drawing is cpu_backend():
        return compute(drawing)
    try:
        return compute(drawing)
    except (ValueError, TypeError):
        # More than shaders take, which the CPU does; or wrong, which it says as well.
        return compute(cpu_backend())
    # Drivers refuse in every way there is: compiler logs, incomplete buffers, no memory.
    except Exception as error:
        gl_driver().give_up()
        warnings.warn(
            f"The graphics card cannot draw this ({error}); the processor does it from here on.",
            RuntimeWarning,
            stacklevel=3,
        )
    return compute(cpu_backend())


def chosen(backend: str) -> RenderBackend:
    """Return the backend of a name.

    Parameters
    ----------
    backend : {"auto", "cpu", "gl"}
        "auto" takes GL on graphics hardware, else the CPU: a software rasteriser is slower
        than our own kernels.

    Raises
    ------
    ValueError
        If the backend is unknown, or "gl" where no GL context can be had.
    """
    if on_cpu(checked_backend(backend)):
        return cpu_backend()
    if backend == "gl" and not gl_driver().available():
        why = gl_driver().unavailable_because()
        raise ValueError(f'backend "gl" needs a GL context: {why}; use "cpu"')
    return gl_backend()


def on_cpu(backend: str) -> bool:
    """Return whether `chosen` is the CPU's."""
    return backend == "cpu" or (backend == "auto" and not gl_driver().hardware())


# The three imports wait until they are needed: vispy alone takes a third of a second.


def cpu_backend() -> RenderBackend:
    """Return the numba kernels."""
    from napari_unpack.rendering import cpu

    return cpu


def gl_backend() -> RenderBackend:
    """Return the shaders."""
    from napari_unpack.rendering.gl import backend

    return backend


def gl_driver() -> Driver:
    """Return the offscreen GL driver."""
    from napari_unpack.rendering.gl import offscreen

    return offscreen
