"""What a controller's parts do when the session, the layers or the canvas change."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from napari_unpack.layers import compat
from napari_unpack.layers.gl_context import ContextWatch, rebuild_layers
from napari_unpack.layers.packed_layer import decorate_canvas
from napari_unpack.layers.view_camera import Frame
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.viewer.clipping_sync import ClippingSync
from napari_unpack.viewer.placement_sync import PlacementSync
from napari_unpack.viewer.protocols import Event
from napari_unpack.viewer.redraw_throttle import RedrawThrottle
from napari_unpack.viewer.removed_layers import close_without_layer
from napari_unpack.viewer.slice_sync import SliceSteps
from napari_unpack.viewer.viewer_state import to_the_end

if TYPE_CHECKING:
    from napari_unpack.viewer.controller import SessionController


class ControllerConnections:
    """Connects events to a controller's parts while its session is open.

    Parameters
    ----------
    controller : SessionController
    """

    def __init__(self, controller: SessionController) -> None:
        self._controller = controller
        self._closing: list[Callable[[], None]] = []
        # Whether the canvas has another size since the event loop last ran, and for a picture.
        self._resized = self._pictured = False

    def open(self) -> None:
        """Connect."""
        one = self._controller
        viewer, renderer, scheduler = one.viewer, one.renderer, one.scheduler
        # Before the layers are drawn, whose first frame must be heard.
        for signal, slot in self._events():
            signal.connect(slot)
        canvas = compat.native_canvas(viewer)
        followed = one.outer_session or one.session
        one.slice_steps = steps = SliceSteps(viewer, followed, one.packed)
        one.interaction.open()
        one.framing.open()
        clipping = ClippingSync(one.packed, one.session, one.sources, one.queries.moved)
        placement = PlacementSync(viewer, one.session, one.layers, one.sources, self._rescaled)
        context = ContextWatch(canvas, self._replace_context, scheduler.later)
        throttle = RedrawThrottle(
            compat.RedrawHook(canvas),
            scheduler,
            one.packed,
            lambda: renderer.turning,
            renderer.packed_renderer.set_view,
        )
        pictures = compat.PictureHook(canvas)
        pictures.install(self._be_pictured)
        self._closing = [
            one.interaction.close,
            one.framing.close,
            compat.when_window_closes(viewer, one.close),
            self._disconnect,
            steps.close,
            clipping.close,
            placement.close,
            context.close,
            throttle.close,
            pictures.remove,
        ]

    def close(self) -> None:
        """Disconnect."""
        closing, self._closing = self._closing, []
        # In reverse: what was put on last goes first.
        to_the_end(*reversed(closing))

    def decorate(self) -> None:
        """Follow the session's background, box and scale bar."""
        decorate_canvas(self._controller.viewer, self._controller.session.decorations)
        self._controller.renderer.decorations_changed()
        # Its box may reach out of the window.
        self._controller.framing.follow()

    def follow_states(self) -> None:
        """Follow the states of the session's objects."""
        self._follow_inspection()
        self._controller.renderer.states_changed()
        self._controller.overlays.states_changed()
        self._controller.queries.moved()
        self._controller.framing.follow()

    def _disconnect(self) -> None:
        for signal, slot in self._events():
            signal.disconnect(slot)

    def _events(self) -> list[tuple[Event, Callable[..., None]]]:
        one = self._controller
        events = one.session.events
        return [
            (events.labels, self._follow_labels),
            (events.labels, one.queries.labels_changed),
            (events.states, self.follow_states),
            (events.states, one.interaction.states_changed),
            (events.hues, self._follow_hues),
            (events.transfer_function, self._follow_transfer_function),
            (events.selected, one.interaction.selection_changed),
            (events.surroundings, self.decorate),
            (events.queue, self._follow_queue),
            (events.measurements, one.rulers.changed),
            (one.events.unpackable, self._follow_unpackable),
            (one.packed.refused, self._tell_refusal),
            (one.packed.frame_changed, self._follow_frame),
            (one.transition.frame_changed, self._follow_other_frame),
            (one.sprites.frame_changed, self._follow_other_frame),
            (one.viewer.layers.events.removed, self._follow_removal),
        ]

    def _follow_frame(self, frame: Frame) -> None:
        one = self._controller
        # Every redraw tells its frame; most show the same view.
        if not frame.same_as(one.frame):
            resized = one.session.canvas_size != frame.size
            one.session.canvas_size = frame.size
            one.session.look(frame.camera)
            one.renderer.set_view(frame)
            one.overlays.set_view(frame)
            one.queries.moved()
            if resized:
                one.framing.follow()
                self._resized = True
                one.scheduler.debounce(0, self._forget_picture)
                if self._pictured:
                    # Back in its own size: nothing has moved for a person.
                    one.renderer.glides.finish()

    def _be_pictured(self) -> None:
        """Have everything where and as it will be, for the picture that is taken now.

        napari gives its canvas another size, reads it, and gives it its own size back within one
        call, in which no image of a worker arrives.
        """
        one = self._controller
        frame = one.packed.frame_now()
        if frame is None:
            return
        self._follow_frame(frame)
        one.renderer.packed_renderer.complete()
        if self._resized:
            self._pictured = True
            one.renderer.glides.finish()

    def _forget_picture(self) -> None:
        self._resized = self._pictured = False

    def _follow_other_frame(self, frame: Frame) -> None:
        # In a grid of views every layer has its own; the bag's is the one that counts.
        if not self._controller.packed.visible:
            self._follow_frame(frame)

    def _follow_labels(self, _edited: frozenset[int]) -> None:
        # What is inspected may be gone, and no object that is left has another state by that.
        self._follow_inspection()
        self._controller.renderer.labels_changed()

    def _follow_inspection(self) -> None:
        one = self._controller
        inspected = next(iter(ids_in(one.session.states, ObjectState.INSPECTED)), 0)
        if inspected:
            one.framing.begin_inspection(inspected)
        else:
            one.framing.end_inspection()

    def _follow_queue(self) -> None:
        self._controller.overlays.states_changed()
        self._controller.queries.queue_changed()

    def _follow_unpackable(self, known: frozenset[int] | None) -> None:
        # First by rays, then by moving voxels, which may say otherwise; None comes with the queue.
        if known is not None:
            self._controller.overlays.outlines.unpackable_known()

    def _follow_hues(self) -> None:
        self._controller.renderer.hues_changed()
        self._controller.slice_hues.paint()

    def _follow_transfer_function(self) -> None:
        self._controller.renderer.transfer_function_changed()
        self._controller.overlays.outlines.redraw()

    def _rescaled(self, words: str) -> None:
        self._controller.events.message.emit(words)
        self._controller.events.rescaled.emit()

    def _replace_context(self) -> None:
        one = self._controller
        one.renderer.context_replaced()
        one.events.message.emit(rebuild_layers(one.viewer, one.layers))

    def _tell_refusal(self, log: str) -> None:
        words = f"This graphics driver cannot show images in napari ({log})."
        self._controller.events.message.emit(words)

    def _follow_removal(self, event: Any) -> None:
        one = self._controller
        # One layer without the others would show half a session.
        if event.value in one.layers:
            if one.layer_removed is None:
                close_without_layer(one)
            else:
                one.layer_removed()
