"""The layer of what is unpacked: one small image per object, in pivot space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.compat import PictureLayer, register
from napari_unpack.layers.rendered_image import (
    CHOSEN,
    CHOSEN_ON_LIGHT,
    RESTING,
    RESTING_ON_LIGHT,
    Sprite,
)
from napari_unpack.layers.view_camera import Frame
from napari_unpack.layers.vispy_adapter import QuadsAdapter
from napari_unpack.rendering.gl.depth_quads import Quad


class SpriteLayer(PictureLayer):
    """Unpacked objects beside the bag. Turning and panning the bag leaves them where they are.

    Parameters
    ----------
    name, spacing, box, **placement
        As for `PictureLayer`; without a box it does not stretch the scene.
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        self._sprites: dict[int, Sprite] = {}
        self._quads: dict[int, Quad] = {}
        self._chosen: frozenset[int] = frozenset()
        self.dimming = 1.0
        self._edges = RESTING, CHOSEN
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    @property
    def sprites(self) -> Mapping[int, Sprite]:
        """What is shown, by object."""
        return self._sprites

    @property
    def nbytes(self) -> int:
        """Memory of the sprites, bytes: as they were cast, and as textures, depths included."""
        return sum(sprite.nbytes for sprite in self._sprites.values())

    def show(self, sprites: Mapping[int, Sprite]) -> None:
        """Show these and nothing else; a sprite that stays the same keeps its quad."""
        same = [i for i, s in sprites.items() if i in self._quads and self._sprites.get(i) is s]
        if len(same) == len(self._sprites) == len(sprites):
            return
        self._sprites, self._quads = dict(sprites), {i: self._quads[i] for i in same}
        if sprites:
            # The one unpacked last is what the user has just seen.
            self.set_picture(next(reversed(self._sprites.values())).patch.rgba)
        self.repaint()

    def choose(self, ids: frozenset[int]) -> None:
        """Give some objects a brighter outline."""
        if ids != self._chosen:
            # Only these change; the others keep their textures.
            for object_id in ids ^ self._chosen:
                self._quads.pop(object_id, None)
            self._chosen = ids
            self.repaint()

    def on_light(self, light: bool) -> None:
        """Draw outlines that stand out from a light background, or from a dark one."""
        self._edges = (RESTING_ON_LIGHT, CHOSEN_ON_LIGHT) if light else (RESTING, CHOSEN)
        self._quads.clear()
        self.repaint()

    def dim(self, factor: float) -> None:
        """Multiply the layer's opacity, for the time something else is looked at."""
        self.dimming = factor
        self._quads.clear()
        self.repaint()

    def at_pixel(self, row: float, col: float, size: tuple[int, int], camera: Camera) -> int:
        """Return the object whose sprite is under a pixel of the view, 0 where none is.

        Parameters
        ----------
        row, col : float
            Pixel of the view.
        size : (int, int)
            Height and width of the view in the same pixels.
        camera : Camera
            The viewer's.

        Returns
        -------
        int
            Pixels that are transparent but inside the silhouette's reach count too, so that
            thin objects can be hit.
        """
        # The one drawn last lies on top.
        for object_id, sprite in reversed(self._sprites.items()):
            flat = camera.flattened(float(sprite.pose.center[0]))
            if flat is None:
                continue
            point, _ = flat.ray((row, col), size)
            if sprite.contains(point, margin=3 * flat.height / size[0]):
                return object_id
        return 0

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return a quad for each sprite."""
        super().quads_at(frame)
        for object_id, sprite in self._sprites.items():
            if object_id not in self._quads:
                edge = self._edges[object_id in self._chosen]
                self._quads[object_id] = sprite.quad(edge, self.dimming)
        return [self._quads[object_id] for object_id in self._sprites]


register(
    SpriteLayer,
    QuadsAdapter,
    "The unpacked objects, one small image each. Double-click one to inspect it; drag it to "
    "turn it.",
)
