"""Quads: images with depth that stand in a vispy scene among other visuals.

The image of the packed bag, of an object in flight and every sprite are quads. Their list is drawn
twice: first the pixels whose alpha reached 1/2, which write depth, then all others, which are
tested against it. So opaque parts hide each other whatever the order of the list, soft edges blend
over what is behind them, and a Points layer drawn before or after is hidden where it should be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vispy import gloo
from vispy.gloo import Texture2D, gl
from vispy.gloo.context import get_current_canvas
from vispy.visuals import Visual
from vispy.visuals.filters import Alpha, PickingFilter

from napari_unpack.geometry.axes import Matrix, flip_matrix
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.gl import formats
from napari_unpack.rendering.gl.framebuffer import NO_DEPTH, forget_complaints, namespace
from napari_unpack.rendering.gl.programs import Programs, ShaderError, compiled, load

PictureArray = NDArray[np.float32] | NDArray[np.uint8]


class ImageTexture:
    """A premultiplied RGBA image with or without depths, uploaded where it is drawn.

    Parameters
    ----------
    color : (h, w, 4) ndarray of float32 or uint8, or Texture2D
        Premultiplied RGBA, row 0 at the top; textures likewise, as the passes fill them.
    depth : (h, w) ndarray of float32, or Texture2D, optional
        t in mm where alpha first reached 1/2; +inf or `NO_DEPTH` where it never did.

    Attributes
    ----------
    uploads : int
        Arrays sent to the graphics card so far.

    Notes
    -----
    Arrays are kept, and sent once to every context the image is drawn in: one that replaces a
    context that was lost gets them as well. Textures of a pass serve in their own context alone.
    """

    def __init__(
        self, color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None = None
    ) -> None:
        self.uploads = self._version = 0
        # By context: the version that is there, and its textures, which may be written to again.
        self._made: WeakKeyDictionary[Any, tuple[int, Texture2D, Texture2D | None]]
        self._made = WeakKeyDictionary()
        self.update(color, depth)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return int(self._color.shape[0]), int(self._color.shape[1])

    def update(
        self, color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None = None
    ) -> None:
        """Replace the contents, in place where size and type stay.

        Parameters
        ----------
        color, depth
            As for the class.
        """
        self._color, self._depth = _checked(color, depth)
        self._version += 1
        self._home = None
        if isinstance(color, Texture2D) and get_current_canvas() is not None:
            self._home = ref(namespace())

    def textures(self) -> tuple[Texture2D, Texture2D | None] | None:
        """Return the colour and depth textures, uploading what is new.

        Returns
        -------
        (Texture2D, Texture2D or None) or None
            None in another context than that of the pass that filled them.
        """
        here = namespace()
        if isinstance(self._color, Texture2D):
            strange = self._home is not None and self._home() is not here
            return None if strange else (self._color, self._depth)
        version, color, depth = self._made.get(here, (0, None, None))
        if version != self._version:
            color = self._uploaded("rgba", self._color, color)
            # Eight bits hold no depth: the image stands in its plane then.
            if self._depth is None or formats.lacking():
                depth = None
            else:
                known = np.where(self._depth < NO_DEPTH, self._depth, np.float32(NO_DEPTH))
                depth = self._uploaded("r", known, depth)
            self._made[here] = self._version, color, depth
        return color, depth

    def _uploaded(self, base: str, array: PictureArray, own: Texture2D | None) -> Texture2D:
        self.uploads += 1
        if array.dtype != np.uint8 and formats.lacking():
            array = np.rint(np.clip(array, 0, 1) * 255).astype(np.uint8)
        internal = base + ("8" if array.dtype == np.uint8 else "32f")
        if own is not None and own.shape[:2] == array.shape[:2] and own.internalformat == internal:
            own.set_data(array)
            return own
        return Texture2D(
            array,
            format="rgba" if base == "rgba" else "red",
            internalformat=internal,
            interpolation="linear" if base == "rgba" else "nearest",
        )


def _checked(
    color: PictureArray | Texture2D, depth: NDArray[np.float32] | Texture2D | None
) -> tuple[PictureArray | Texture2D, NDArray[np.float32] | Texture2D | None]:
    if len(color.shape) != 3 or color.shape[2] != 4 or 0 in color.shape:
        raise ValueError(f"color must be (h, w, 4) premultiplied RGBA, got shape {color.shape}")
    if not isinstance(color, Texture2D) and color.dtype not in (np.float32, np.uint8):
        raise TypeError(f"color must be float32 or uint8, got {color.dtype}")
    if depth is not None and tuple(depth.shape[:2]) != tuple(color.shape[:2]):
        raise ValueError(f"depth must be {color.shape[:2]} like color, got {depth.shape[:2]}")
    return color, depth


# Top left corner, edge to the right, edge down, each (4,) in clip space (x, y, z, w).
Frame = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class ScreenPlace:
    """A rectangle in normalised device coordinates; by default the whole view.

    Parameters
    ----------
    left, top, right, bottom : float
        Outer edges of the image, -1 left and bottom, 1 right and top.
    t : float
        Depth of what has none of its own, mm from the pivot plane away from the viewer.
    ndc_depth : float, optional
        Put the whole quad at this depth instead, -1 nearest, 1 farthest (a background).
    in_view : bool
        Whether they are those of the view, which may be a part of the canvas; else the canvas's.
    """

    left: float = -1.0
    top: float = 1.0
    right: float = 1.0
    bottom: float = -1.0
    t: float = 0.0
    ndc_depth: float | None = None
    in_view: bool = True

    @classmethod
    def of_pixels(
        cls, row: int, col: int, size: tuple[int, int], canvas: tuple[int, int], t: float = 0.0
    ) -> ScreenPlace:
        """Place a patch of `size` (h, w) whose first pixel is (row, col) of a canvas (H, W).

        Parameters
        ----------
        row, col : int
            First pixel.
        size, canvas : (int, int)
            Height and width of the patch and of the canvas, pixels.
        t : float
            Depth of what has none of its own, mm.
        """
        height, width = canvas
        return cls(
            left=2 * col / width - 1,
            top=1 - 2 * row / height,
            right=2 * (col + size[1]) / width - 1,
            bottom=1 - 2 * (row + size[0]) / height,
            t=t,
        )

    def frame(self, clip_from_pivot: Matrix) -> Frame:
        """Return where the image's corner and edges are in clip space."""
        return (
            np.array([self.left, self.top, 0.0, 1.0]),
            np.array([self.right - self.left, 0.0, 0.0, 0.0]),
            np.array([0.0, self.bottom - self.top, 0.0, 0.0]),
        )

    @property
    def t_origin(self) -> float:
        """What to add to the image's depths, mm: they count from the pivot plane."""
        return 0.0


@dataclass(frozen=True)
class PivotPlace:
    """A rectangle in pivot space that faces the viewer: a sprite.

    Parameters
    ----------
    center : (float, float, float)
        Its middle, mm: towards the viewer, down, right.
    half : (float, float)
        Half its height and half its width, mm.

    Notes
    -----
    The image's depths count from the middle's plane, away from the viewer.
    """

    center: tuple[float, float, float]
    half: tuple[float, float]
    ndc_depth: float | None = None

    @property
    def t(self) -> float:
        """Depth of what has none of its own, mm: the plane of the middle."""
        return -float(self.center[0])

    @property
    def t_origin(self) -> float:
        """What to add to the image's depths, mm: they count from the middle's plane."""
        return self.t

    def frame(self, clip_from_pivot: Matrix) -> Frame:
        """Return where the image's corner and edges are in clip space."""
        towards, down, right = self.center
        corner = np.array([towards, down - self.half[0], right - self.half[1], 1.0])
        return (
            clip_from_pivot @ corner,
            clip_from_pivot[:, 2] * 2 * self.half[1],
            clip_from_pivot[:, 1] * 2 * self.half[0],
        )


Place = ScreenPlace | PivotPlace


def depth_row(clip_from_pivot: Matrix, ndc_depth: float | None = None) -> NDArray[np.float64]:
    """Return the (4,) numbers a, b, c, d of z_ndc(t) = (a t + b) / (c t + d).

    Parameters
    ----------
    clip_from_pivot : (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space (x, y, z, w). Its depth
        must not depend on down and right, which holds for every camera that is not sheared.
    ndc_depth : float, optional
        The answer for every t instead.
    """
    if ndc_depth is not None:
        return np.array([0.0, ndc_depth, 0.0, 1.0])
    z, w = clip_from_pivot[2], clip_from_pivot[3]
    return np.array([-z[0], z[3], -w[0], w[3]])


def clip_from_pivot(render_from_world: ArrayLike, camera: Camera) -> Matrix:
    """Make the matrix quads want from the one vispy draws with.

    Parameters
    ----------
    render_from_world : (4, 4) array_like
        From world mm (x, y, z, 1) to clip space, acting on column vectors: `matrices.matrix_of`
        of the vispy transform from the scene to "render".
    camera : Camera
        Whose pivot space is meant.

    Returns
    -------
    (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space (x, y, z, w).
    """
    world_from_pivot = flip_matrix(np.linalg.inv(camera.pivot_from_world()))
    # Columns in the order towards, down, right, as pivot space has its axes.
    order = [2, 1, 0, 3]
    product: Matrix = (np.asarray(render_from_world, dtype=np.float64) @ world_from_pivot)[:, order]
    return product


WHOLE_SCREEN = ScreenPlace()


@dataclass(frozen=True, eq=False)
class Quad:
    """One image at one place.

    Parameters
    ----------
    image : ImageTexture
        Premultiplied RGBA, with or without depths. Keep and `update` it: a quad made anew
        around the same image uploads nothing.
    place : ScreenPlace or PivotPlace
        On the screen (the packed bag, an object's box) or in pivot space (a sprite).
    opacity : float
        Of this quad.
    before : ImageTexture, optional
        Colours it comes from, of the same size and without own depths.
    mix : float
        Share of `image` in what is shown, the rest is `before`'s.
    """

    image: ImageTexture
    place: Place = WHOLE_SCREEN
    opacity: float = 1.0
    before: ImageTexture | None = None
    mix: float = 1.0


class QuadsVisual(Visual):  # type: ignore[misc]
    """Draw a list of quads.

    Attributes
    ----------
    quads : sequence of Quad
        What to draw; assigning redraws. Order matters only among translucent pixels: later
        quads are drawn over earlier ones.
    clip_from_pivot : (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space, column vectors; see
        `clip_from_pivot`. Places sprites and turns t into depths.
    clip_from_view : (4, 4) ndarray of float64
        From the clip space of the view to that of the canvas it is a part of, column vectors.
    before_draw : callable, optional
        Called with this visual at the start of every draw, while vispy's transforms and the
        current GL context are those of the drawing canvas: the moment to set
        `clip_from_pivot` and `quads` from the camera, or to run a `TintedCaster`.
    refused : callable, optional
        Given the driver's log, once, where it does not accept the quads' shader; nothing is
        drawn then.

    Notes
    -----
    It owns its GL state: premultiplied blending (one, one_minus_src_alpha), depth test on, depth
    written by the core draw only, culling off. Presets set from outside, as napari's
    `VispyBaseLayer.reset` does, have no effect. The depth mask is on afterwards and the depth
    function as it was found (vispy wants "less", napari's canvas "lequal").
    vispy's opacity filter, which napari sets from the layer, would scale alpha alone and is
    replaced by a uniform; picking by vispy's own render is not supported (nothing is drawn).
    """

    def __init__(self, quads: Sequence[Quad] = ()) -> None:
        # Before Visual.__init__: scene nodes attach their filters during theirs.
        self._alpha_filter: Any = None
        vertex, fragment = load("passes/quad.vert"), load("passes/quad.frag")
        Visual.__init__(self, vcode=vertex.code, fcode=fragment.code)
        self.unfreeze()
        self._quads: tuple[Quad, ...] = tuple(quads)
        self.clip_from_pivot: Matrix = np.diag([1.0, 1.0, 1.0, 1.0])[[2, 1, 0, 3]]
        self.clip_from_view: Matrix = np.eye(4)
        self.before_draw: Callable[[QuadsVisual], None] | None = None
        self.refused: Callable[[str], None] | None = None
        self._broken = False
        self._programs = Programs()
        self._blanks: WeakKeyDictionary[Any, gloo.Texture2D] = WeakKeyDictionary()
        self.freeze()

    @property
    def quads(self) -> tuple[Quad, ...]:
        """What is drawn."""
        return self._quads

    @quads.setter
    def quads(self, quads: Sequence[Quad]) -> None:
        self._quads = tuple(quads)
        self.update()

    def attach(self, filt: Any, view: Any = None) -> None:
        """Attach a filter; the node's opacity is taken over, its picking left out.

        Parameters
        ----------
        filt, view
            As vispy hands them.
        """
        if isinstance(filt, Alpha):
            self._alpha_filter = filt
        elif not isinstance(filt, PickingFilter):
            super().attach(filt, view)

    def draw(self) -> None:
        """Draw all quads in the current context and viewport."""
        if self._broken or not self.visible or getattr(self, "picking", False):
            return
        if self.before_draw is not None:
            self.before_draw(self)
        overall = 1.0 if self._alpha_filter is None else float(self._alpha_filter.alpha)
        # Nothing is uploaded for what would not be seen.
        wanted = [quad for quad in self._quads if quad.opacity * overall > 0.0]
        found = [(quad, quad.image.textures()) for quad in wanted]
        shown = [(quad, textures) for quad, textures in found if textures is not None]
        if not shown:
            return
        try:
            program = self._ready_program()
        except ShaderError as error:
            # At every paint it would fail again.
            self._broken = True
            if self.refused is None:
                raise
            self.refused(str(error))
            return
        # A canvas of one pixel leaves Qt's own errors, which PyOpenGL would raise as ours.
        forget_complaints()
        depth_func = gl.glGetParameter(gl.GL_DEPTH_FUNC)
        # Opaque pixels first: translucent ones blend over what depth leaves visible.
        for core in (True, False):
            gloo.set_state(
                depth_test=True,
                depth_mask=core,
                depth_func="lequal",
                cull_face=False,
                blend=True,
                blend_equation="func_add",
                blend_func=("one", "one_minus_src_alpha"),
            )
            for quad, textures in shown:
                if core or len(shown) > 1:
                    self._set(program, quad, textures, overall)
                program["u_core"] = float(core)
                program.draw("triangle_strip")
        gloo.set_state(depth_mask=True, depth_func=depth_func)

    def _ready_program(self) -> gloo.Program:
        """Return the program of the current context, which may have replaced an earlier one."""
        program = self._programs.kept("quad", lambda: compiled("quad.frag", vertex="quad.vert"))
        if namespace() not in self._blanks:
            corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], dtype=np.float32)
            program["a_corner"] = gloo.VertexBuffer(corners)
            blank = gloo.Texture2D(np.zeros((1, 1, 4), np.uint8), internalformat="rgba8")
            self._blanks[namespace()] = blank
        return program

    def _set(
        self,
        program: gloo.Program,
        quad: Quad,
        textures: tuple[gloo.Texture2D, gloo.Texture2D | None],
        overall: float,
    ) -> None:
        color, depth = textures
        earlier = None if quad.before is None else quad.before.textures()
        before = color if earlier is None else earlier[0]
        origin, right, down = quad.place.frame(self.clip_from_pivot)
        if isinstance(quad.place, ScreenPlace) and quad.place.in_view:
            origin, right, down = (self.clip_from_view @ each for each in (origin, right, down))
        values: dict[str, Any] = {
            "u_image": color,
            "u_before": before,
            "u_mix": 1.0 if earlier is None else quad.mix,
            "u_depth": self._blanks[namespace()] if depth is None else depth,
            "u_has_depth": float(depth is not None),
            "u_t": quad.place.t,
            "u_t_origin": quad.place.t_origin,
            "u_z_of_t": depth_row(self.clip_from_pivot, quad.place.ndc_depth),
            "u_opacity": quad.opacity * overall,
            "u_clip_origin": origin,
            "u_clip_right": right,
            "u_clip_down": down,
        }
        for name, value in values.items():
            program[name] = value

    def _prepare_transforms(self, view: Any) -> None:
        """Do nothing: quads are placed by `clip_from_pivot`."""

    def _compute_bounds(self, axis: int, view: Any) -> None:
        """Have no extent: quads never change what a camera frames."""
        return
