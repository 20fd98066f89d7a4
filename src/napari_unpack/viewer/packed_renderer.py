"""When the packed image is cast again, how finely, and where: the cached layer of section 5.3."""

from __future__ import annotations

from collections.abc import Iterable
from time import perf_counter
from typing import TYPE_CHECKING

from napari_unpack.appearance import hues_between
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import packed_image
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.tasks import Cancelled, Task
from napari_unpack.viewer.animation import HueFade
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.dirty_region import recast_objects
from napari_unpack.viewer.scheduler import IdlePhase, Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Rays on the short side of the coarsest preview, however slow the machine is.
FEWEST_RAYS = 384

# Of a preview on the processor; with all that comes round it, ten images a second and more.
FRAME_SECONDS = 0.055

# Of a preview on the graphics card, which draws the rest of the canvas in the same 16 ms.
GL_FRAME_SECONDS = 0.012

# On the graphics card the rays change in such steps, so that few frame buffers are made.
GL_RAYS_STEP = 32

# Slow previews are far apart, and no sign that the camera rests: that takes up to this long.
SLOWEST_IDLE_MS = 500

# Where a full image takes the graphics card longer, new colours come at once.
FADING_SECONDS = 0.03


class PackedRenderer:
    """Keeps the packed layer's image right with as few passes as can be.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    layer : PackedLayer
        Shows the image, or nothing where nothing of the bag is in view.
    canvas_backend : CanvasBackend
        Casts on the canvas where it is active; else a worker thread does, on the CPU.

    Attributes
    ----------
    passes : int
        Castings of the packed image so far: previews, full images and regions.
    fade : HueFade
        The transition to new colours.

    Notes
    -----
    While the camera moves a preview has about 384 rays on its short side, as many as keep ten
    frames a second; the full image has all of them, once the camera rests. The image before stays
    until the next one is there. An object that leaves or comes back recasts its own region alone.
    New colours come in a short transition: on the CPU from the image before to the finished new
    one, on the graphics card by tints on their way.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        layer: PackedLayer,
        canvas_backend: CanvasBackend,
    ) -> None:
        self.passes = 0
        self.fade = HueFade(scheduler, self._on_fade)
        self._session, self._scheduler, self._layer = session, scheduler, layer
        self._canvas_backend = canvas_backend
        self._scene = session.scene()
        self._hues = self._hues_before = session.hues
        self._recolored = False
        self._seconds = 0.0
        self._canvas_image: CanvasImage | None = None
        self._frame: Frame | None = None
        self._revision = 0
        self._image: RenderedImage | None = None
        self._fading_from: RenderedImage | None = None
        self._full_for: tuple[Frame, int] | None = None
        self._rays = float(FEWEST_RAYS)
        # The revision at which an object changed that the image does not show yet.
        self._changed: dict[int, int] = {}
        self._whole: Subvolume | None = None
        scheduler.on_idle(IdlePhase.IMAGE, self._on_idle)
        # Where the machine is slow, redraws are further apart than a camera takes to rest.
        scheduler.hold_idle("preview", lambda: scheduler.has("packed", Worker.PREVIEW))

    @property
    def turning(self) -> bool:
        """Whether an image is being cast on the processor, the last one drawn."""
        casting = not self._canvas_backend.active and self._scheduler.has("packed")
        return self._layer.drawn and casting

    @property
    def settled(self) -> bool:
        """Whether the image is full and right for what the canvas shows, and drawn."""
        image = self._canvas_image
        # Neither hidden nor in slices is there a draw to wait for.
        hidden = not self._layer.visible or self._layer.frame_now() is None
        drawn = image is None or image.ready or hidden
        return self._frame is None or (self.is_full and drawn and not self.fade.running)

    def subvolume(self, scene: Scene) -> Subvolume:
        """Return the whole volume as the kernels want it; for worker threads too."""
        self._whole = whole = scene.subvolumes.whole()
        return whole

    def known_subvolume(self) -> Subvolume:
        """Return the whole volume as last made ready, which may be of labels just repaired."""
        # The mouse must not wait until repaired labels are ready.
        return self._whole or self.subvolume(self._session.scene())

    def set_view(self, frame: Frame) -> None:
        """Take note of what the canvas shows now."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self._cast_preview()

    def complete(self) -> None:
        """Have the image full and right at once: for a picture of the canvas, however long."""
        frame, revision = self._frame, self._revision
        if frame is None or self.is_full or not self._layer.visible:
            return
        if self._canvas_backend.active:
            self._cast_full()
            return
        self._scheduler.cancel("packed")
        self._scheduler.skip_idle(IdlePhase.IMAGE)
        image, _ = self._cast(self._session.scene(), frame, frame.size, 1.0)
        self._full_done(image, frame, revision)

    def set_scene(self, scene: Scene) -> None:
        """Cast again what differs from the scene before."""
        found, self._scene = scene.difference(self._scene), scene
        # Repaired labels come with everything else, once they are made ready and sent.
        if found.labels:
            return
        if found.appearance:
            self.recast()
            return
        if found.tints:
            self.refine()
        self.recast_objects(found.ids)

    def recast(self) -> None:
        """Cast again since the look of everything has changed."""
        self._revision += 1
        if self._frame is not None:
            self._cast_preview()

    def backend_changed(self) -> None:
        """Cast again since the canvas has begun to cast, or does so no more."""
        # How fast the other backend was says nothing of this one.
        self._image, self._canvas_image, self._rays = None, None, float(FEWEST_RAYS)
        self._scheduler.set_idle_delay(IdlePhase.IMAGE, 0)
        self.recast()

    def refine(self) -> None:
        """Cast again since colours have changed, without a preview between."""
        self._revision += 1
        now = {**self._hues, **hues_between(self._hues_before, self._hues, self.fade.part)}
        self._hues_before, self._hues = now, self._session.hues
        if self._frame is None:
            return
        self._recolored = self.fade.allowed
        if self._canvas_backend.active and self.fade.allowed and self._seconds < FADING_SECONDS:
            self._canvas_backend.hues_on_the_way = hues_between(now, self._hues, 0.0)
            self.fade.begin()
        self._cast_full()

    def recast_objects(self, ids: Iterable[int]) -> None:
        """Cast again where some objects are, since they have left, come back or changed."""
        new = set(ids)
        if not new:
            return
        before, self._revision = self._revision, self._revision + 1
        self._changed |= dict.fromkeys(new, self._revision)
        frame, image = self._frame, self._image
        if frame is None:
            return
        # Only beside a full image of just before is everything else right.
        if self._full_for != (frame, before):
            self._cast_preview()
            return
        if self._canvas_backend.active:
            self._cast_full()
            return
        if image is None:
            self._cast_preview()
            return
        changed = frozenset(self._changed)
        wanted, scene = (frame, self._revision), self._session.scene()
        self._full_for = wanted
        self._scheduler.submit(
            Task("packed region", lambda _: self._cast_region(scene, image, changed)),
            Worker.PREVIEW,
            lambda image: self._region_done(image, wanted),
            failed=lambda error: self._try_again(error, frame),
        )

    def close(self) -> None:
        """Ask for no more images."""
        self._scheduler.skip_idle(IdlePhase.IMAGE)
        self.fade.stop()
        self._frame = self._image = self._canvas_image = self._fading_from = None

    def _on_fade(self, part: float) -> None:
        if self._canvas_backend.active:
            self._canvas_backend.hues_on_the_way = (
                {} if part >= 1.0 else hues_between(self._hues_before, self._hues, part)
            )
            self._revision += 1
            self._cast_full()
        else:
            self._layer.mix(part)

    def _show(
        self,
        image: RenderedImage | CanvasImage | None,
        before: RenderedImage | None = None,
        with_thumbnail: bool = True,
    ) -> None:
        # Another image than the one that colours fade to.
        if before is None and isinstance(image, RenderedImage):
            self.fade.stop()
        self._layer.show(image, before, with_thumbnail)

    def _on_idle(self) -> None:
        if self.is_full:
            self._layer.update_thumbnail()
        else:
            self._cast_full()

    @property
    def is_full(self) -> bool:
        """Whether the image has all rays and is of the newest view and objects, or will be."""
        return self._full_for == (self._frame, self._revision) and not self._changed

    def _cast_region(
        self, scene: Scene, image: RenderedImage, changed: frozenset[int]
    ) -> RenderedImage | None:
        self.passes += 1
        return recast_objects(scene, self.subvolume(scene), image, changed)

    def _region_done(self, image: RenderedImage | None, wanted: tuple[Frame, int]) -> None:
        if self._full_for == wanted:
            self._forget_changes(wanted[1])
            self._image = image
            self._show(image)
        elif not (
            self.is_full or self._scheduler.has("packed") or self._scheduler.has("packed region")
        ):
            self._cast_full()

    def _forget_changes(self, revision: int) -> None:
        """Forget what was changed up to a revision that the image shows."""
        self._changed = {i: at for i, at in self._changed.items() if at > revision}

    def _cast_preview(self) -> None:
        frame, revision = self._frame, self._revision
        if frame is None:
            return
        self._full_for = None
        self._scheduler.touch(IdlePhase.IMAGE)
        rays = self._rays
        if self._canvas_backend.active:
            rays = rays // GL_RAYS_STEP * GL_RAYS_STEP
        share = min(1.0, rays / min(frame.size))
        size = max(1, round(frame.size[0] * share)), max(1, round(frame.size[1] * share))
        # Fewer samples along fewer rays: hardly seen while things move.
        step = 1.0 if share == 1.0 else 1.5
        if self._canvas_backend.active:
            self._cast_on_canvas(frame, size, step, adapts=True)
            return
        scene = self._session.scene()
        self._scheduler.submit(
            Task("packed", lambda _: self._cast(scene, frame, size, step)),
            Worker.PREVIEW,
            lambda result: self._preview_done(result, frame, revision, share == 1.0),
        )

    def _preview_done(
        self, result: tuple[RenderedImage | None, float], frame: Frame, revision: int, whole: bool
    ) -> None:
        image, seconds = result
        # Asked for before the graphics card took over.
        if self._canvas_backend.active:
            return
        self._adapt(seconds, FRAME_SECONDS, frame)
        # Half an image more than it took: the next movement may come with the next one.
        idle_ms = min(SLOWEST_IDLE_MS, round(1500 * seconds))
        self._scheduler.set_idle_delay(IdlePhase.IMAGE, idle_ms)
        # A full image has overtaken this preview.
        if self._full_for is not None and self._full_for[0] is self._frame:
            return
        self._image = image
        if whole and frame is self._frame and revision == self._revision:
            self._full_for = (frame, revision)
            self._forget_changes(revision)
        self._show(image, with_thumbnail=False)

    def _try_again(self, error: Exception, frame: Frame) -> None:
        # Memory that was short for a moment may be there now. The next view has its own image.
        if frame is self._frame and not isinstance(error, Cancelled):
            self._cast_full(last=True)

    def _cast_full(self, last: bool = False) -> None:
        frame, revision = self._frame, self._revision
        if frame is None or self.is_full:
            return
        self._scheduler.skip_idle(IdlePhase.IMAGE)
        if self._canvas_backend.active:
            self._cast_on_canvas(frame, frame.size, 1.0, adapts=False)
            return
        scene = self._session.scene()
        self._scheduler.submit(
            Task("packed", lambda _: self._cast(scene, frame, frame.size, 1.0)),
            Worker.REFINE,
            lambda result: self._full_done(result[0], frame, revision),
            # What fails twice is told.
            failed=None if last else lambda error: self._try_again(error, frame),
        )

    def _full_done(self, image: RenderedImage | None, frame: Frame, revision: int) -> None:
        # The camera has moved on, and a preview is under way.
        if frame is not self._frame:
            return
        if revision != self._revision:
            # Colours that came meanwhile have asked for their image, which may be under way.
            if not self._scheduler.has("packed", Worker.REFINE):
                self._cast_full()
            return
        before, recolored = self._image, self._recolored
        self._image, self._full_for, self._recolored = image, (frame, revision), False
        self._forget_changes(revision)
        if not (recolored and before and image and image.covers(before)):
            self._show(image)
            return
        if self._fading_from is not None and self.fade.running:
            before = before.mixed(self._fading_from, self.fade.part)
        self._fading_from = before
        self._show(image, before)
        self.fade.begin()

    def _cast_on_canvas(
        self, frame: Frame, size: tuple[int, int], step: float, adapts: bool
    ) -> None:
        """Have the image cast when the canvas is drawn next."""
        whole = size == frame.size
        if whole:
            self._full_for = (frame, self._revision)
            self._forget_changes(self._revision)
            self._scheduler.skip_idle(IdlePhase.IMAGE)
        self._image = None
        self._canvas_image = self._canvas_backend.packed(
            frame.camera, size, step, lambda seconds: self._canvas_done(seconds, frame, adapts)
        )
        self._show(self._canvas_image)

    def _canvas_done(self, seconds: float, frame: Frame, adapts: bool) -> None:
        self.passes += 1
        self._seconds = seconds
        # Slow frames are far apart, and no sign that the camera rests.
        self._scheduler.set_idle_delay(IdlePhase.IMAGE, round(2500 * seconds))
        if adapts:
            self._adapt(seconds, GL_FRAME_SECONDS, frame)

    def _adapt(self, seconds: float, wanted: float, frame: Frame) -> None:
        # Time goes with the square of the rays a side; one slow frame counts for little.
        change = (wanted / max(seconds, 1e-4)) ** 0.5
        self._rays = max(FEWEST_RAYS, self._rays * min(max(change, 0.7), 1.3))
        self._rays = min(self._rays, max(FEWEST_RAYS, min(frame.size)))

    def _cast(
        self, scene: Scene, frame: Frame, size: tuple[int, int], step: float
    ) -> tuple[RenderedImage | None, float]:
        self.passes += 1
        began = perf_counter()
        image = cast_packed(scene, frame.camera, size, step)
        return image, perf_counter() - began


def cast_packed(
    scene: Scene, camera: Camera, size: tuple[int, int], step: float
) -> RenderedImage | None:
    """Cast the packed image; for worker threads.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.
    step : float
        Distance of samples, smallest voxel edges.

    Returns
    -------
    RenderedImage or None
        None where nothing of the bag is in view.
    """
    return RenderedImage.of(packed_image(scene, camera, size, step, "cpu"), camera, size)
