"""Images on their way to the canvas: cast by a worker, or by the canvas's own GL when drawn.

An image knows the camera it was cast for, and so where it stands when another camera looks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import triple
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.gl.depth_quads import ImageTexture, PivotPlace, Quad
from napari_unpack.rendering.image_patch import ImagePatch
from napari_unpack.rendering.outlines import Silhouette, decorated


@dataclass(frozen=True)
class ImagePlace(PivotPlace):
    """A rectangle in the pivot plane of the camera that an image was cast for.

    Parameters
    ----------
    center, half, ndc_depth
        As for `PivotPlace`, in the pivot space of the camera that looks now.
    plane : float
        Where pixels stand that have no depth of their own, mm behind the image's own pivot
        plane.
    """

    plane: float = 0.0

    @property
    def t(self) -> float:
        """Depth of what has none of its own, mm from the pivot plane of the camera."""
        return self.plane - float(self.center[0])

    @property
    def t_origin(self) -> float:
        """What to add to the image's depths, mm."""
        return -float(self.center[0])


def image_place(
    image: RenderedImage | CanvasImage, patch: ImagePatch | Window, seen_by: Camera
) -> ImagePlace:
    """Place a patch of an image where it belongs under the camera that looks now.

    Parameters
    ----------
    image : RenderedImage or CanvasImage
    patch : ImagePatch or Window
        Where its pixels are in the whole image.
    seen_by : Camera
        The camera that looks now.

    Notes
    -----
    Under the same camera this is the patch's window, exactly; after a zoom or a pan the old
    image follows at once, while the new one is being cast. A turn it cannot follow.
    """
    made_for, (rows, cols), (height, width) = image.camera, image.size, patch.size
    # In the pivot plane, where perspective changes no size.
    mm = made_for.height / rows
    towards, down, right = seen_by.linear @ (made_for.center - seen_by.center)
    place = ImagePlace(
        center=(
            float(towards),
            float(down) + (patch.row + (height - rows) / 2) * mm,
            float(right) + (patch.col + (width - cols) / 2) * mm,
        ),
        half=(height * mm / 2, width * mm / 2),
        plane=patch.plane,
    )
    return replace(place, ndc_depth=FRONT) if image.in_front else place


# Faint, so that a row of sprites is no row of frames; chosen ones are meant to be seen.
RESTING = Silhouette(outline=(1.0, 1.0, 1.0, 0.22), outline_width=1.0)
CHOSEN = Silhouette(outline=(1.0, 1.0, 1.0, 0.95), outline_width=2.0)
RESTING_ON_LIGHT = Silhouette(
    outline=(0.0, 0.0, 0.0, 0.3), outline_width=1.0, shadow=(0.0, 0.0, 0.0, 0.22)
)
CHOSEN_ON_LIGHT = Silhouette(
    outline=(0.05, 0.06, 0.09, 0.95), outline_width=2.0, shadow=(0.0, 0.0, 0.0, 0.22)
)

# Depth of what is before everything else, normalised device coordinates.
FRONT = -0.999


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """A patch of an image cast for one camera.

    Parameters
    ----------
    patch : ImagePatch
        Pixels, depths, window.
    texture : ImageTexture
        The same, for the graphics card.
    camera : Camera
        The camera it was cast for.
    size : (int, int)
        Height and width of the whole image, pixels.
    in_front : bool
        Draw it before everything else instead of where it is.
    """

    patch: ImagePatch
    texture: ImageTexture
    camera: Camera
    size: tuple[int, int]
    in_front: bool = False

    @classmethod
    def of(cls, patch: ImagePatch, camera: Camera, size: tuple[int, int]) -> RenderedImage | None:
        """Return the image of a patch; None where it has no pixels. For worker threads too.

        Parameters
        ----------
        patch, camera, size
            See the class.
        """
        if patch.is_empty:
            return None
        # Made in the worker: turning floats into bytes takes milliseconds of a frame.
        return cls(patch, ImageTexture(to_bytes(patch.rgba), patch.depth), camera, size)

    @property
    def thumbnail(self) -> NDArray[np.float32]:
        """(h, w, 4) pixels for the layer list."""
        return self.patch.rgba

    def covers(self, other: RenderedImage) -> bool:
        """Return whether pixels of both show the same rays."""
        mine, theirs = self.patch, other.patch
        # One camera object a frame: identity is enough, and free.
        return self.camera is other.camera and (self.size, mine.row, mine.col, mine.size) == (
            other.size,
            theirs.row,
            theirs.col,
            theirs.size,
        )

    def mixed(self, before: RenderedImage, part: float) -> RenderedImage:
        """Return the image that is so far on the way from another.

        Parameters
        ----------
        before : RenderedImage
            Which it must cover.
        part : float
            Of the way, in [0, 1].
        """
        rgba = before.patch.rgba + np.float32(part) * (self.patch.rgba - before.patch.rgba)
        patch = replace(self.patch, rgba=rgba)
        return replace(self, patch=patch, texture=ImageTexture(to_bytes(rgba), patch.depth))

    def quad(self, seen_by: Camera, opacity: float = 1.0) -> Quad:
        """Return the quad that shows it where it belongs.

        Parameters
        ----------
        seen_by : Camera
            What looks now.
        opacity : float, optional
        """
        return Quad(self.texture, image_place(self, self.patch, seen_by), opacity)


@dataclass(frozen=True, eq=False)
class Sprite:
    """The small image of an unpacked object, in pivot space.

    Parameters
    ----------
    patch : ImagePatch
        Of `rendering.compose.sprite_image`, its colours as float16.
    pose : Pose
        Where it waits and how it is turned.
    mm : float
        Size of a pixel, mm.
    textures : dict
        The same for the graphics card, by the silhouette laid under it.
    """

    patch: ImagePatch
    pose: Pose
    mm: float
    textures: dict[Silhouette, ImageTexture] = field(default_factory=dict)

    @classmethod
    def of(cls, patch: ImagePatch, pose: Pose, mm: float) -> Sprite | None:
        """Return the sprite of a patch; None where it has no pixels. For worker threads too.

        Parameters
        ----------
        patch, pose, mm
            See the class.
        """
        if patch.is_empty:
            return None
        # Half precision, since it is kept for as long as the object is out.
        slim: Any = patch.rgba.astype(np.float16)
        sprite = cls(replace(patch, rgba=slim), pose, mm)
        # Already in the worker, since all sprites are first shown so.
        sprite.texture(RESTING)
        return sprite

    @property
    def nbytes(self) -> int:
        """Memory of its pixels, bytes: as cast, and four of colour and of depth as textures."""
        drawn = sum(8 * p.size[0] * p.size[1] for p in self.textures.values())
        return self.patch.rgba.nbytes + self.patch.depth.nbytes + drawn

    @property
    def place(self) -> PivotPlace:
        """The rectangle of its image, without a silhouette's margin."""
        height, width = self.patch.rgba.shape[:2]
        depth, down, right = triple(self.pose.center)
        # Rows and columns of its patch count from the object's centre.
        down += (self.patch.row - 0.5 + height / 2) * self.mm
        right += (self.patch.col - 0.5 + width / 2) * self.mm
        return PivotPlace((depth, down, right), (height * self.mm / 2, width * self.mm / 2))

    def is_at(self, pose: Pose) -> bool:
        """Tell whether it is drawn at a place, and as large as it is to be there."""
        same = np.array_equal(self.pose.center, pose.center)
        return same and self.pose.scale == pose.scale

    def moved(self, pose: Pose) -> Sprite:
        """Return the same image elsewhere, as large as it is to be there."""
        return replace(self, pose=pose, mm=self.mm * pose.scale / self.pose.scale)

    def texture(self, silhouette: Silhouette) -> ImageTexture:
        """Return its image with a silhouette, made at the first call (some milliseconds)."""
        if silhouette not in self.textures:
            m = silhouette.margin
            # The silhouette reaches past the object and has no depth of its own.
            depth = np.pad(self.patch.depth, m, constant_values=np.inf)
            rgba = to_bytes(decorated(self.patch.rgba.astype(np.float32), silhouette))
            self.textures[silhouette] = ImageTexture(rgba, depth)
        return self.textures[silhouette]

    def quad(self, silhouette: Silhouette, opacity: float = 1.0) -> Quad:
        """Return its quad.

        Parameters
        ----------
        silhouette : Silhouette
            Laid under it.
        opacity : float, optional
        """
        place, margin = self.place, silhouette.margin * self.mm
        half = place.half[0] + margin, place.half[1] + margin
        return Quad(self.texture(silhouette), replace(place, half=half), opacity)

    def contains(self, pivot_point: NDArray[np.float64], margin: float = 0.0) -> bool:
        """Return whether a point of its plane lies on its rectangle.

        Parameters
        ----------
        pivot_point : (3,) ndarray of float64
            Pivot space, mm.
        margin : float, optional
            By which the rectangle is widened, mm.
        """
        # Only the two axes of its plane count here.
        place = self.place
        down, right = np.abs(pivot_point[1:] - place.center[1:])
        return bool(down <= place.half[0] + margin and right <= place.half[1] + margin)


def to_bytes(rgba: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return colours in [0, 1] as bytes, a quarter of the upload."""
    return (np.clip(rgba, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


# Windows are widened to multiples of this, so that few frame buffers serve all.
WIDEN_PIXELS = 64


@dataclass(frozen=True)
class Window:
    """A rectangle of an image, placed as a `ImagePatch` is.

    Parameters
    ----------
    row, col : int
        Its first pixel; may be negative.
    size : (int, int)
        Height and width, pixels.
    plane : float
        t of the middle of what is shown, mm.
    """

    row: int
    col: int
    size: tuple[int, int]
    plane: float

    @classmethod
    def around(cls, window: tuple[int, int, int, int], plane: float) -> Window:
        """Return a window widened to the right and down.

        Parameters
        ----------
        window : (int, int, int, int)
            First row and column, height and width, pixels.
        plane : float
            t of the middle of what is shown, mm.
        """
        # Rounded up; what is cast besides is empty and costs next to nothing.
        row, col, height, width = window
        return cls(
            row,
            col,
            (-(-height // WIDEN_PIXELS) * WIDEN_PIXELS, -(-width // WIDEN_PIXELS) * WIDEN_PIXELS),
            plane,
        )


@dataclass(eq=False)
class CanvasImage:
    """An image for one camera, cast when it is first drawn.

    Parameters
    ----------
    window : Window
        The part of the image that is cast.
    camera : Camera
        The camera it is for.
    size : (int, int)
        Height and width of the whole image, pixels.
    develop : callable
        Casts it; called once, with the canvas's context current. None: it could not be cast.
    in_front : bool
        Draw it before everything else instead of where it is.
    """

    window: Window
    camera: Camera
    size: tuple[int, int]
    develop: Callable[[], ImageTexture | None]
    in_front: bool = False
    ready: bool = field(default=False, init=False)
    _texture: ImageTexture | None = field(default=None, init=False)

    thumbnail: None = field(default=None, init=False)
    """Nothing is read back from the graphics card for the layer list."""

    def quad(self, seen_by: Camera, opacity: float = 1.0) -> Quad | None:
        """Return the quad that shows it; None where it could not be cast.

        Parameters
        ----------
        seen_by : Camera
            What looks now.
        opacity : float, optional
        """
        # Once: a refused image would be refused at every draw.
        if not self.ready:
            self._texture, self.ready = self.develop(), True
        if self._texture is None:
            return None
        return Quad(self._texture, image_place(self, self.window, seen_by), opacity)
