"""When the packed picture is cast again, how finely, and where: the cached layer of section 5.3.

Send volumes to the graphics card piece by piece, while the CPU's picture stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import perf_counter
from typing import Any

from qtpy.QtCore import QTimer

from napari_unpack.appearance import hues_between
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import packed_image
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume, SubvolumeCache
from napari_unpack.viewer.animation import HueFade
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.dirty_region import recast_objects
from napari_unpack.viewer.jobs import Jobs, single_shot, stop

FEWEST_RAYS = 384
FRAME_SECONDS = 0.055
"""Of a cast while the view turns; with all that comes round it, ten pictures a second and more."""

GL_FRAME_SECONDS = 0.012
GL_RAYS_STEP = 32
"""On the graphics card the rays change in such steps, so that few frame buffers are made."""

REST_MS = 120
SLOWEST_REST_MS = 500
"""Slow pictures are far apart, and no sign that the camera rests: that takes up to this long."""

FADING_SECONDS = 0.03
"""Where a full picture takes the graphics card longer, new colours come at once."""


class PackedRenderer:
    """Keeps the packed layer's picture right with as few passes as can be.

    Parameters
    ----------
    session : Session
        What is packed.
    jobs : Jobs
        With the lanes "quick" (while something moves) and "fine" (at rest).
    layer : PackedLayer
        Shows the picture, or nothing where nothing of the bag is in view.
    studio : CanvasBackend
        Casts on the canvas where it is active; else a worker thread does, on the CPU.

    Attributes
    ----------
    passes : int
        Castings of the packed picture so far, coarse, fine and partial.
    fade : HueFade
        The transition to new colours.

    Notes
    -----
    While the camera moves the picture has about 384 rays on its short side, as many as keep ten
    frames a second, then all of them once the camera rests. The picture before stays until the
    next one is there. An object that leaves or comes back recasts its own window alone. New
    colours come in a short transition: on the CPU from the picture before to the finished new
    one, on the graphics card by tints on their way.
    """

    def __init__(
        self,
        session: Any,
        jobs: Jobs,
        layer: PackedLayer,
        studio: CanvasBackend,
    ) -> None:
        self.passes = 0
        self.fade = HueFade(self._fade_on)
        self._session, self._jobs, self._layer = session, jobs, layer
        self._studio = studio
        self._hues = self._hues_before = session.hues
        self._recolored = False
        self._seconds = 0.0
        self._live: CanvasImage | None = None
        self._frame: Frame | None = None
        self._state = 0
        self._shot: RenderedImage | None = None
        self._fading_from: RenderedImage | None = None
        self._finest: tuple[Frame, int] | None = None
        self._rays = float(FEWEST_RAYS)
        # When an object was last changed of which the picture does not tell yet.
        self._touched: dict[int, int] = {}
        self._cache: SubvolumeCache | None = None
        self._rest = single_shot(self._come_to_rest, REST_MS)

    @property
    def turning(self) -> bool:
        """Whether a picture for the canvas is being cast on the processor, the last one drawn."""
        return self._layer.drawn and not self._studio.active and self._jobs.has("packed")

    @property
    def settled(self) -> bool:
        """Whether the picture is full and right for what the canvas shows."""
        drawn = self._live is None or self._live.ready or not self._layer.visible
        return self._frame is None or (self._is_fine() and drawn and not self.fade.running)

    def crop(self) -> Subvolume:
        """Return the whole volume as the kernels want it."""
        cache, scene = self._cache, self._session.scene()
        if cache is None or cache.labels is not scene.labels:
            fresh = SubvolumeCache(scene.volume, scene.labels, scene.boxes, scene.spacing)
            if cache is not None and cache.volume is fresh.volume:
                fresh.taking_over(cache)
            fresh.whole()
            self._cache = cache = fresh
        return cache.whole()

    def known_crop(self) -> Subvolume:
        """Return the whole volume as last made ready, which may be of labels just repaired."""
        return self.crop() if self._cache is None else self._cache.whole()

    def look(self, frame: Frame) -> None:
        """Take note of what the canvas shows now."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self._ask_coarse()

    def recast(self) -> None:
        """Cast again since the look of everything has changed."""
        self._state += 1
        if self._frame is not None:
            self._ask_coarse()

    def change_caster(self) -> None:
        """Cast again since the studio has become active, or is so no more."""
        self._shot, self._live, self._rays = None, None, float(FEWEST_RAYS)
        self._rest.setInterval(REST_MS)
        self.recast()

    def refine(self) -> None:
        """Cast again since colours have changed, without a coarse picture between."""
        self._state += 1
        now = {**self._hues, **hues_between(self._hues_before, self._hues, self.fade.part)}
        self._hues_before, self._hues = now, self._session.hues
        if self._frame is None:
            return
        self._recolored = self.fade.allowed
        if self._studio.active and self.fade.allowed and self._seconds < FADING_SECONDS:
            self._studio.hues_on_the_way = hues_between(now, self._hues, 0.0)
            self.fade.begin()
        self._ask_fine()

    def recast_objects(self, ids: Iterable[int]) -> None:
        """Cast again where some objects are, since they have left, come back or changed."""
        new = set(ids)
        if not new:
            return
        before, self._state = self._state, self._state + 1
        self._touched |= dict.fromkeys(new, self._state)
        frame, shot = self._frame, self._shot
        if frame is None:
            return
        if self._finest != (frame, before):
            self._ask_coarse()
            return
        if self._studio.active:
            self._ask_fine()
            return
        if shot is None:
            self._ask_coarse()
            return
        touched = frozenset(self._touched)
        wanted = self._finest = (frame, self._state)
        self._jobs.ask(
            "quick",
            "packed window",
            lambda: self._window(shot, touched),
            lambda patched: self._patched(patched, wanted),
        )

    def close(self) -> None:
        """Stop asking for pictures."""
        stop(self._rest)
        self.fade.stop()
        self._frame = None

    def _fade_on(self, part: float) -> None:
        if self._studio.active:
            self._studio.hues_on_the_way = (
                {} if part >= 1.0 else hues_between(self._hues_before, self._hues, part)
            )
            self._state += 1
            self._ask_fine()
        else:
            self._layer.mix(part)

    def _show(
        self,
        shot: RenderedImage | CanvasImage | None,
        before: RenderedImage | None = None,
        resting: bool = True,
    ) -> None:
        if before is None and isinstance(shot, RenderedImage):
            self.fade.stop()
        self._layer.show(shot, before, resting)

    def _come_to_rest(self) -> None:
        if self._jobs.turning:
            self._rest.start()
        elif self._is_fine():
            self._layer.come_to_rest()
        else:
            self._ask_fine()

    def _is_fine(self) -> bool:
        return self._finest == (self._frame, self._state) and not self._touched

    def _window(self, shot: RenderedImage | None, touched: frozenset[int]) -> RenderedImage | None:
        self.passes += 1
        if shot is None:
            return None
        return recast_objects(self._session.scene(), self.crop(), shot, touched, "cpu")

    def _patched(self, shot: RenderedImage | None, wanted: tuple[Frame, int]) -> None:
        if self._finest == wanted:
            self._tells_all(wanted[1])
            self._shot = shot
            self._show(shot)
        elif not (self._is_fine() or self._jobs.has("packed") or self._jobs.has("packed window")):
            self._ask_fine()

    def _tells_all(self, state: int) -> None:
        """Forget who was changed up to a state of which there is a picture now."""
        self._touched = {i: at for i, at in self._touched.items() if at > state}

    def _ask_coarse(self) -> None:
        frame, state = self._frame, self._state
        if frame is None:
            return
        self._finest = None
        self._rest.start()
        rays = self._rays
        if self._studio.active:
            rays = rays // GL_RAYS_STEP * GL_RAYS_STEP
        share = min(1.0, rays / min(frame.size))
        size = max(1, round(frame.size[0] * share)), max(1, round(frame.size[1] * share))
        step = 1.0 if share == 1.0 else 1.5
        if self._studio.active:
            self._expose(frame, size, step, adapts=True)
            return
        scene = self._session.scene()
        self._jobs.ask(
            "quick",
            "packed",
            lambda: self._cast(scene, frame, size, step),
            lambda result: self._coarse_done(result, frame, state, share == 1.0),
        )

    def _coarse_done(
        self, result: tuple[RenderedImage | None, float], frame: Frame, state: int, whole: bool
    ) -> None:
        shot, seconds = result
        if self._studio.active:
            return
        self._adapt(seconds, FRAME_SECONDS, frame)
        self._rest.setInterval(max(REST_MS, min(SLOWEST_REST_MS, round(1500 * seconds))))
        if self._finest is not None and self._finest[0] is self._frame:
            return
        self._shot = shot
        if whole and frame is self._frame and state == self._state:
            self._finest = (frame, state)
            self._tells_all(state)
        self._show(shot, resting=False)

    def _ask_fine(self) -> None:
        frame, state = self._frame, self._state
        if frame is None or self._is_fine():
            return
        self._rest.stop()
        if self._studio.active:
            self._expose(frame, frame.size, 1.0, adapts=False)
            return
        scene = self._session.scene()
        self._jobs.ask(
            "fine",
            "packed",
            lambda: self._cast(scene, frame, frame.size, 1.0),
            lambda result: self._fine_done(result[0], frame, state),
        )

    def _fine_done(self, shot: RenderedImage | None, frame: Frame, state: int) -> None:
        if frame is not self._frame:
            return
        if state != self._state:
            self._ask_fine()
            return
        before, recolored = self._shot, self._recolored
        self._shot, self._finest, self._recolored = shot, (frame, state), False
        self._tells_all(state)
        if not (recolored and before and shot and shot.covers(before)):
            self._show(shot)
            return
        if self._fading_from is not None and self.fade.running:
            before = before.mixed(self._fading_from, self.fade.part)
        self._fading_from = before
        self._show(shot, before)
        self.fade.begin()

    def _expose(self, frame: Frame, size: tuple[int, int], step: float, adapts: bool) -> None:
        """Have the picture cast when the canvas is drawn next."""
        whole = size == frame.size
        if whole:
            self._finest = (frame, self._state)
            self._tells_all(self._state)
            self._rest.stop()
        self._shot = None
        self._live = self._studio.packed(
            frame.camera, size, step, lambda seconds: self._exposed(seconds, frame, adapts)
        )
        self._show(self._live)

    def _exposed(self, seconds: float, frame: Frame, adapts: bool) -> None:
        self.passes += 1
        self._seconds = seconds
        # Slow frames are far apart, and no sign that the camera rests.
        self._rest.setInterval(max(REST_MS, round(2500 * seconds)))
        if adapts:
            self._adapt(seconds, GL_FRAME_SECONDS, frame)

    def _adapt(self, seconds: float, wanted: float, frame: Frame) -> None:
        change = (wanted / max(seconds, 1e-4)) ** 0.5
        self._rays = max(FEWEST_RAYS, self._rays * min(max(change, 0.7), 1.3))
        self._rays = min(self._rays, max(FEWEST_RAYS, min(frame.size)))

    def _cast(
        self, scene: Scene, frame: Frame, size: tuple[int, int], step: float
    ) -> tuple[RenderedImage | None, float]:
        self.passes += 1
        began = perf_counter()
        shot = cast_packed(scene, frame.camera, size, step)
        return shot, perf_counter() - began


def cast_packed(
    scene: Scene, camera: Camera, size: tuple[int, int], step: float
) -> RenderedImage | None:
    """Cast the packed picture; for worker threads."""
    return RenderedImage.of(packed_image(scene, camera, size, step, "cpu"), camera, size)


class VolumeUpload:
    """Sends one piece each time the canvas is drawn, since only then GL may be spoken to.

    Parameters
    ----------
    studio : CanvasBackend
        Who has what is to be sent.
    packed : PackedLayer
        Whose drawing is waited for.
    caster_changed : callable
        Given, after a piece, whether GL cast before it.
    refine : callable
        Called once all labels that were repaired are there.
    """

    def __init__(
        self,
        studio: CanvasBackend,
        packed: PackedLayer,
        caster_changed: Callable[[bool], None],
        refine: Callable[[], None],
    ) -> None:
        self._studio, self._packed = studio, packed
        self._caster_changed, self._refine = caster_changed, refine
        self._sending = self._relabelled = self._closed = False
        packed.on_draw = self._send

    @property
    def busy(self) -> bool:
        """Whether pieces are on their way, or wait for a canvas that will be drawn."""
        return self._sending or (self._studio.waiting and self._packed.visible)

    def go_on(self) -> None:
        """Have the canvas drawn if anything waits to be sent."""
        if self._studio.waiting:
            self._packed.repaint()

    def refine_when_sent(self) -> None:
        """Have the picture refined once everything is there; at once if nothing waits."""
        self._relabelled = self._studio.waiting and self._studio.active
        if not self._relabelled:
            self._refine()

    def close(self) -> None:
        """Send nothing more."""
        self._closed = True
        self._packed.on_draw = _nothing

    def _send(self) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        if self._studio.waiting:
            before, self._sending = self._studio.active, True
            self._studio.send()
            QTimer.singleShot(0, lambda: self._sent(before))

    def _sent(self, before: bool) -> None:
        self._sending = False
        if self._closed:
            return
        self._caster_changed(before)
        self.go_on()
        if self._relabelled and not self._studio.waiting:
            self._relabelled = False
            self._refine()


def _nothing() -> None:
    """Do nothing."""
