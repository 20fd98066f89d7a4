"""What the rows measure on, each made once a run and only if a row asks for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.packing import Packing, pack
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import Camera, View

MM = np.ones(3)
SHADING = Shading()


class Scenes:
    """Volumes, views and sessions, shared by the rows.

    Parameters
    ----------
    quick : bool
        Halves every edge: for looking whether the benchmarks run, not for figures.

    Attributes
    ----------
    figures : dict of str to str
        File names and contents that rows leave beside the table.
    """

    def __init__(self, quick: bool = False) -> None:
        self.quick = quick
        self.repeats = 1 if quick else 3
        self.figures: dict[str, str] = {}

    def edge(self, n: int) -> int:
        """Return an edge's length in this run."""
        return n // 2 if self.quick else n

    def shape(self, z: int, y: int, x: int) -> tuple[int, int, int]:
        """Return a volume's shape in this run."""
        return self.edge(z), self.edge(y), self.edge(x)

    @property
    def canvas(self) -> tuple[int, int]:
        """The picture's size, 1024 x 1024."""
        return self.edge(1024), self.edge(1024)

    @cached_property
    def packing(self) -> Packing:
        """256 x 256 x 512 with 27 objects."""
        return pack(self.shape(256, 256, 512), (3, 3, 3))

    @cached_property
    def crowd(self) -> Packing:
        """384 x 384 x 512 with 60 objects."""
        return pack(self.shape(384, 384, 512), (4, 3, 5))

    @cached_property
    def bricks(self) -> Any:
        """Of `packing`."""
        from napari_unpack.rendering.cpu import Bricks

        return Bricks.of(self.packing.labels, self.packing.volume)

    @cached_property
    def camera(self) -> Camera:
        """An oblique view of `packing`, filling the picture as napari's reset does."""
        shape = self.packing.volume.shape
        whole = View((0.5, 0.35, 1.0)).camera(shape, MM)
        return Camera(whole.rotation, whole.center, whole.height * 0.75)

    @cached_property
    def transfer_function(self) -> Any:
        """Clear air, opacity 0.1 a voxel from the foreground on."""
        from napari_unpack.appearance import TransferFunction

        return TransferFunction([(0, 0.0), (200, 0.0), (600, 0.1), (4000, 0.1)])

    @cached_property
    def tints(self) -> NDArray[np.float32]:
        """A colour an object."""
        colors = np.random.default_rng(1).uniform(0.2, 1.0, (self.packing.count + 1, 4))
        colors[:, 3] = 1
        colors[0] = 0
        return colors.astype(np.float32)

    def tinted(self, backend: str) -> Any:
        """Cast a frame of `packing` in its tints, with either backend."""
        from napari_unpack.rendering import cast_tinted

        return cast_tinted(
            self.packing.volume,
            self.packing.labels,
            MM,
            self.camera,
            self.transfer_function,
            self.tints,
            self.canvas,
            shading=SHADING,
            bricks=self.bricks,
            backend=backend,
        )

    @cached_property
    def vtk(self) -> Callable[[], Any]:
        """Casts a frame of `packing` with VTK's ray caster for the CPU."""
        from benchmarks.vtk_peer import vtk_frame

        return vtk_frame(self)

    @cached_property
    def session(self) -> Any:
        """A session on `packing`."""
        from napari_unpack.session import Session

        session = Session(self.packing.volume, self.packing.labels)
        session.transfer_function = self.transfer_function
        return session
