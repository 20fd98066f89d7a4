"""Cards: flat pictures with depth that stand in a vispy scene among other visuals.

The packed bag's cached picture, an object in flight and every sprite are cards. Their list is
drawn twice: first the pixels whose alpha reached 1/2, which write depth, then all others, which
are tested against it. So opaque parts hide each other whatever the order of the list, soft edges
blend over what is behind them, and a Points layer drawn before or after is hidden where it should
be (DESIGN.md, decision 4.4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from vispy import gloo
from vispy.gloo import gl
from vispy.visuals import Visual
from vispy.visuals.filters import Alpha, PickingFilter

from napari_unpack.geometry.axes import Matrix
from napari_unpack.rendering.framebuffer import forget_complaints, namespace
from napari_unpack.rendering.ledger import TABLES, ledger
from napari_unpack.rendering.programs import Programs, ShaderError
from napari_unpack.rendering.shader_source import load
from napari_unpack.rendering.visuals.pictures import Picture
from napari_unpack.rendering.visuals.places import Place, ScreenPlace, depth_row

WHOLE_SCREEN = ScreenPlace()


@dataclass(frozen=True, eq=False)
class Card:
    """One picture at one place.

    Parameters
    ----------
    picture : Picture
        Premultiplied RGBA, with or without depths. Keep and `update` it: a card made anew
        around the same picture uploads nothing.
    place : ScreenPlace or PivotPlace
        On the screen (the packed bag, an object's box) or in pivot space (a sprite).
    opacity : float
        Of this card.
    before : Picture, optional
        Colours it comes from, of the same size and without own depths.
    mix : float
        Share of `picture` in what is shown, the rest is `before`'s.
    """

    picture: Picture
    place: Place = WHOLE_SCREEN
    opacity: float = 1.0
    before: Picture | None = None
    mix: float = 1.0


class CardsVisual(Visual):  # type: ignore[misc]
    """Draw a list of cards.

    Attributes
    ----------
    cards : sequence of Card
        What to draw; assigning redraws. Order matters only among translucent pixels: later
        cards are drawn over earlier ones.
    clip_from_pivot : (4, 4) ndarray of float64
        From pivot space (towards, down, right, 1) in mm to clip space, column vectors; see
        `places.clip_from_pivot`. Places sprites and turns t into depths.
    cards_opacity : float
        Of all cards together. A scene node's own `opacity` (napari sets it from the layer)
        is multiplied on.
    before_draw : callable, optional
        Called with this visual at the start of every draw, while vispy's transforms and the
        current GL context are those of the drawing canvas: the moment to set
        `clip_from_pivot` and `cards` from the camera, or to run a `TintedCaster`.
    refused : callable, optional
        Given the driver's log, once, where it does not accept the cards' shader; nothing is
        drawn then.
    draws : int
        How many times it was drawn.

    Notes
    -----
    It owns its GL state: premultiplied blending (one, one_minus_src_alpha), depth test on, depth
    written by the core draw only, culling off. Presets set from outside, as napari's
    `VispyBaseLayer.reset` does, have no effect. The depth mask is on afterwards and the depth
    function as it was found (vispy wants "less", napari's canvas "lequal").
    vispy's opacity filter would scale alpha alone and is replaced by a uniform; picking by
    vispy's own render is not supported (nothing is drawn).
    """

    def __init__(self, cards: Sequence[Card] = ()) -> None:
        # Before Visual.__init__: scene nodes attach their filters during theirs.
        self._alpha_filter: Any = None
        vertex, fragment = load("passes/card.vert"), load("passes/card.frag")
        Visual.__init__(self, vcode=vertex.code, fcode=fragment.code)
        self.unfreeze()
        self._cards: tuple[Card, ...] = tuple(cards)
        self._clip_from_pivot: Matrix = np.diag([1.0, 1.0, 1.0, 1.0])[[2, 1, 0, 3]]
        self.cards_opacity = 1.0
        self.before_draw: Callable[[CardsVisual], None] | None = None
        self.refused: Callable[[str], None] | None = None
        self._broken = False
        self.draws = 0
        self._programs = Programs()
        self._blanks: WeakKeyDictionary[Any, gloo.Texture2D] = WeakKeyDictionary()
        self.freeze()

    @property
    def cards(self) -> tuple[Card, ...]:
        """What is drawn."""
        return self._cards

    @cards.setter
    def cards(self, cards: Sequence[Card]) -> None:
        self._cards = tuple(cards)
        self.update()

    @property
    def clip_from_pivot(self) -> Matrix:
        """From pivot space in mm to clip space."""
        return self._clip_from_pivot

    @clip_from_pivot.setter
    def clip_from_pivot(self, matrix: Matrix) -> None:
        self._clip_from_pivot = np.asarray(matrix, dtype=np.float64)

    def attach(self, filt: Any, view: Any = None) -> None:
        """Attach a filter; the node's opacity is taken over, its picking left out."""
        if isinstance(filt, Alpha):
            self._alpha_filter = filt
        elif not isinstance(filt, PickingFilter):
            super().attach(filt, view)

    def draw(self) -> None:
        """Draw all cards in the current context and viewport."""
        if self._broken or not self.visible or getattr(self, "picking", False):
            return
        if self.before_draw is not None:
            self.before_draw(self)
        self.draws += 1
        overall = self.cards_opacity * (
            1.0 if self._alpha_filter is None else float(self._alpha_filter.alpha)
        )
        wanted = [card for card in self._cards if card.opacity * overall > 0.0]
        found = [(card, card.picture.textures()) for card in wanted]
        shown = [(card, textures) for card, textures in found if textures is not None]
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
            for card, textures in shown:
                if core or len(shown) > 1:
                    self._set(program, card, textures, overall)
                program["u_core"] = float(core)
                program.draw("triangle_strip")
        gloo.set_state(depth_mask=True, depth_func=depth_func)

    def _ready_program(self) -> gloo.Program:
        """Return the program of the current context, which may have replaced an earlier one."""
        program = self._programs.here("card.frag", vertex="card.vert")
        if namespace() not in self._blanks:
            corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], dtype=np.float32)
            program["a_corner"] = ledger().enter(TABLES, gloo.VertexBuffer(corners))
            blank = gloo.Texture2D(np.zeros((1, 1), np.float32), internalformat="r32f")
            self._blanks[namespace()] = ledger().enter(TABLES, blank)
        return program

    def _set(
        self,
        program: gloo.Program,
        card: Card,
        textures: tuple[gloo.Texture2D, gloo.Texture2D | None],
        overall: float,
    ) -> None:
        color, depth = textures
        earlier = None if card.before is None else card.before.textures()
        before = color if earlier is None else earlier[0]
        origin, right, down = card.place.frame(self._clip_from_pivot)
        values: dict[str, Any] = {
            "u_picture": color,
            "u_before": before,
            "u_mix": 1.0 if earlier is None else card.mix,
            "u_depth": self._blanks[namespace()] if depth is None else depth,
            "u_has_depth": float(depth is not None),
            "u_t": card.place.t,
            "u_t_origin": card.place.t_origin,
            "u_z_of_t": depth_row(self._clip_from_pivot, card.place.ndc_depth),
            "u_opacity": card.opacity * overall,
            "u_clip_origin": origin,
            "u_clip_right": right,
            "u_clip_down": down,
        }
        for name, value in values.items():
            program[name] = value

    def _prepare_transforms(self, view: Any) -> None:
        """Do nothing: cards are placed by `clip_from_pivot`."""

    def _compute_bounds(self, axis: int, view: Any) -> None:
        """Have no extent: cards never change what a camera frames."""
        return
