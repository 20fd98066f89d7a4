"""The layer of what moves: objects in the air, and the one that is inspected."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from napari_unpack.layers.compat import PictureLayer, register
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.slice_frame import SliceFrame
from napari_unpack.layers.view_camera import Frame
from napari_unpack.layers.vispy_adapter import QuadsAdapter
from napari_unpack.rendering.gl.depth_quads import Quad


class TransitionLayer(PictureLayer):
    """Objects between the bag and their places, each in a quad of its own.

    Parameters
    ----------
    name, spacing, box, **placement
        As for `PictureLayer`; without a box it does not stretch the scene.
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        self._images: dict[int, RenderedImage | CanvasImage] = {}
        self.overlays: Callable[[Frame], Sequence[Quad]] | None = None
        self.slice_overlays: Callable[[SliceFrame], Sequence[Quad]] | None = None
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    @property
    def images(self) -> dict[int, RenderedImage | CanvasImage]:
        """What is shown, by object."""
        return dict(self._images)

    def show(self, images: Mapping[int, RenderedImage | CanvasImage]) -> None:
        """Show these and nothing else."""
        fresh = images.keys() - self._images.keys()
        self._images = dict(images)
        # One is enough: several would overwrite one another.
        for object_id in list(fresh)[:1]:
            self.set_picture(images[object_id].thumbnail)
        self.repaint()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return a quad for each object in the air, over what is drawn upon the bag."""
        super().quads_at(frame)
        under = () if self.overlays is None else self.overlays(frame)
        quads = (image.quad(frame.camera) for image in self._images.values())
        return [*under, *(quad for quad in quads if quad is not None)]

    def slice_quads_at(self, frame: SliceFrame) -> Sequence[Quad]:
        """Return what is drawn upon a slice."""
        return () if self.slice_overlays is None else self.slice_overlays(frame)


register(
    TransitionLayer,
    QuadsAdapter,
    "Objects that fly out of the bag or back, and the inspected one. Empty while nothing moves.",
)
