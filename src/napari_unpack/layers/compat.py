# ruff: noqa: TID251
"""Every private napari and vispy name of the project, and what to do when one has moved.

napari draws a layer with the visual registered for its class and shows the controls registered
for its class. Both registries are private, so the three image layers are put into them here and
nowhere else. Where a registry is missing, `problem()` says so in a sentence, and no session is
opened in the viewer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Protocol
from weakref import ref

import numpy as np
from napari.layers import Layer
from napari.utils.colormaps import DirectLabelColormap
from numpy.typing import ArrayLike, NDArray
from psygnal import Signal
from vispy.gloo.context import get_current_canvas

if TYPE_CHECKING:
    import napari
    from napari.utils.colormaps import CyclicLabelColormap
    from qtpy.QtCore import QObject
    from qtpy.QtWidgets import QMainWindow
    from vispy.scene import SceneCanvas

    from napari_unpack.layers.slice_frame import SliceFrame
    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.rendering.gl.depth_quads import Quad

try:
    from napari._qt.layer_controls.qt_layer_controls_base import QtLayerControls
    from napari._qt.layer_controls.qt_layer_controls_container import layer_to_controls
    from napari._vispy.layers.base import VispyBaseLayer
    from napari._vispy.utils.visual import layer_to_visual
    from napari.layers.base.base import _LayerSlicingState as SlicingState

    _PROBLEM = ""
except ImportError as error:
    VispyBaseLayer = QtLayerControls = SlicingState = object
    layer_to_visual, layer_to_controls = {}, {}
    _PROBLEM = (
        f"This napari keeps its layer registry elsewhere ({error}), so the packed image cannot "
        "be drawn in the viewer. Use a napari of the series 0.9, or the Python API."
    )


def problem() -> str:
    """Return why this napari cannot show our layers, a sentence to show; empty where it can."""
    return _PROBLEM


def color_labels(colormap: CyclicLabelColormap | DirectLabelColormap, labels: ArrayLike) -> None:
    """Colour labels as napari's thumbnails and canvas do, so that it has compiled that.

    Parameters
    ----------
    colormap : CyclicLabelColormap or DirectLabelColormap
    labels : array_like of int
    """
    values = np.asarray(labels)
    colormap.map(values)
    # Without it the first look at labels would compile for a second, in the middle of a frame.
    with suppress(AttributeError):
        colormap._data_to_texture(values)


class TabledColormap(DirectLabelColormap):
    """napari's colours by ID from a table, where it has numba compile a dictionary for a second."""

    def _map_without_cache(self, values: NDArray[np.integer]) -> NDArray[np.float32]:
        # Of at most 16 bits, so that a table of all there are is small.
        span = np.iinfo(values.dtype)
        table: NDArray[np.float32] = np.empty((span.max - span.min + 1, 4), np.float32)
        table[:] = self.default_color
        known = [i for i in self.color_dict if i is not None and span.min <= i <= span.max]
        if known:
            table[np.array(known) - span.min] = [self.color_dict[i] for i in known]
        return table[values.astype(np.intp) - span.min]


def register(layer: type[Layer], adapter: type[Any], sentence: str) -> None:
    """Teach napari how to draw a layer class and which controls to show for it.

    Parameters
    ----------
    layer : type
        Subclass of `PictureLayer`.
    adapter : type
        Subclass of `PictureAdapter` that draws it.
    sentence : str
        What the controls say about the layer.
    """
    if not problem():
        layer_to_visual[layer] = adapter
        layer_to_controls[layer] = _controls(sentence)
        # Some versions of napari have more buttons, which they find by class too.
        with suppress(ImportError):
            from napari._qt.layer_controls.dynamic import qt_dynamic_layer_controls as dynamic

            dynamic.buttons_dict[layer] = dynamic.QtMultiLayerButtons


def unwrap(proxy: Any) -> Any:
    """Return the napari object behind the proxy that plugins are handed."""
    # The proxy refuses private names, and we compare layers by identity.
    return getattr(proxy, "__wrapped__", proxy)


def _qt_viewer(viewer: napari.Viewer) -> Any:
    return getattr(getattr(unwrap(viewer), "window", None), "_qt_viewer", None)


def native_canvas(viewer: napari.Viewer) -> SceneCanvas | None:
    """Return the vispy canvas of a viewer, or None where it has no window any more."""
    return getattr(getattr(_qt_viewer(viewer), "canvas", None), "_scene_canvas", None)


def native_window(viewer: napari.Viewer) -> QMainWindow | None:
    """Return the Qt window of a viewer, or None where it has none any more."""
    return getattr(getattr(unwrap(viewer), "window", None), "_qt_window", None)


def viewer_dropped_on() -> napari.Viewer | None:
    """Return the viewer that a file was dropped on, which napari tells no reader.

    What is dropped comes from another program, so that none of our windows is active: it is that
    which the mouse is over. Else it is the one napari calls current; None where there is none.
    """
    from napari import current_viewer

    current = current_viewer()
    own = None if current is None else native_window(current)
    if own is None or own.isActiveWindow():
        return current
    from qtpy.QtGui import QCursor
    from qtpy.QtWidgets import QApplication

    window = QApplication.topLevelAt(QCursor.pos())
    return getattr(getattr(window, "_qt_viewer", None), "viewer", None) or current


def draw_in_units(viewer: napari.Viewer, layer: Layer, units: Sequence[Any] | None) -> None:
    """Have a layer's visual stand in napari's world now: by itself it waits for the next draw.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : napari layer
    units : sequence of pint.Unit or None
        Of napari's world; None where those of its layers clash.
    """
    # Other versions of napari keep units elsewhere; the next draw then sets all right.
    with suppress(AttributeError, KeyError):
        _qt_viewer(viewer).canvas.layer_to_visual[layer].world_units = units


@contextmanager
def clash_told(viewer: napari.Viewer) -> Iterator[None]:
    """Have layers come and go: that the units of others clash has been said, and is not again."""
    canvas, layers = getattr(_qt_viewer(viewer), "canvas", None), unwrap(viewer).layers
    update = getattr(canvas, "_update_world_units", None)
    pending = getattr(canvas, "_needs_world_units_update", True)
    # Other versions of napari have other names. What waits for a draw has not been said.
    if canvas is None or update is None or pending or not layers or layers.extent.units:
        yield
        return
    # napari draws at once. In a clash each layer stands in units of its own, as when it comes.
    canvas._update_world_units = lambda: layers.extent.units and update()
    try:
        yield
    finally:
        del canvas._update_world_units


def is_shown(viewer: napari.Viewer) -> bool:
    """Return whether a viewer's canvas can be seen: not before it is shown, nor while it closes."""
    native = getattr(native_canvas(viewer), "native", None)
    # Qt deletes a widget while Python still holds it: any call raises RuntimeError then.
    with suppress(RuntimeError):
        return native is not None and bool(native.isVisible())
    return False


def quits_with(window: QObject) -> bool:
    """Return whether closing a window of napari's is to end the application: *Exit*."""
    return bool(getattr(window, "_quit_app", False))


def call_off_exit(window: QObject) -> None:
    """Have a window of napari's end nothing but itself when it is closed next."""
    if quits_with(window):
        window._quit_app = False


class RedrawHook:
    """Takes a canvas's requests for a redraw, by replacing its `update`.

    None, the canvas of a viewer without a window, asks for nothing.
    """

    def __init__(self, canvas: SceneCanvas | None) -> None:
        self._canvas = canvas
        self._asked: Callable[[], None] = lambda: None

    @property
    def is_drawing(self) -> bool:
        """Whether the canvas is being drawn, during which it asks for no redraw."""
        return bool(getattr(self._canvas, "_drawing", False))

    def install(self, asked: Callable[[], None]) -> None:
        """Call in place of every redraw that is asked for."""
        if self._canvas is not None:
            # Nodes ask their canvas for redraws: there is no event to hold off.
            self._asked, self._update = asked, self._canvas.update
            self._canvas.update = self._on_update

    def redraw(self) -> None:
        """Have the canvas drawn."""
        if self._canvas is not None:
            self._update()

    def remove(self) -> None:
        """Give the canvas its own method back."""
        if self._canvas is not None and vars(self._canvas).get("update") == self._on_update:
            del self._canvas.update

    def _on_update(self, node: Any = None) -> None:
        self._asked()


class PictureHook:
    """Tells when napari takes a picture of a canvas, by replacing what reads its pixels.

    None, the canvas of a viewer without a window, has no picture taken.
    """

    def __init__(self, canvas: SceneCanvas | None) -> None:
        self._canvas = canvas
        self._native: Any = getattr(canvas, "native", None)
        self._taken: Callable[[], None] = lambda: None

    def install(self, taken: Callable[[], None]) -> None:
        """Call before every picture, with the canvas's context current."""
        grab = getattr(self._native, "grabFramebuffer", None)
        # Other widgets of vispy's are read in other ways.
        if grab is not None:
            # Qt draws within it, and sends no event that tells it from any other draw.
            self._taken, self._grab = taken, grab
            self._native.grabFramebuffer = self._on_grab

    def remove(self) -> None:
        """Give the widget its own method back."""
        own = getattr(self._native, "__dict__", {})
        if own.get("grabFramebuffer") == self._on_grab:
            del self._native.grabFramebuffer

    def _on_grab(self) -> Any:
        if self._canvas is not None:
            self._canvas.set_current()
        self._taken()
        return self._grab()


_GUARDED = "finishes_in_own_context"


def finish_in_own_context(canvas: SceneCanvas | None) -> None:
    """Make `finish` of a canvas's context run in that context; once is enough.

    None, the canvas of a viewer without a window, is left alone; others have a Qt backend.

    When layers go, napari calls `context.finish()` on their canvas so that the driver lets go of
    them before the scene is rebuilt. It does not make the canvas current first. With two viewers
    open the current context may be the other one's, and GL names are only numbers: the programs
    and textures deleted there are the ones the other canvas draws with, which then stays empty.

    It stays for the canvas's life: napari takes the layers of a closing window down last of all.
    Before the context is made, and after it went with its window, nothing runs: what is queued
    waits for the first draw, or has gone with the context. The canvas that was current is so
    again afterwards.
    """
    context = getattr(canvas, "context", None)
    if canvas is None or context is None or getattr(context, _GUARDED, False):
        return
    finish = context.finish

    def finish_here() -> None:
        if not _has_context(canvas):
            return
        previous = get_current_canvas()
        canvas.set_current()
        try:
            finish()
        finally:
            if previous is not None and previous is not canvas and _has_context(previous):
                previous.set_current()

    context.finish = finish_here
    setattr(context, _GUARDED, True)


def _has_context(canvas: SceneCanvas) -> bool:
    """Return whether a canvas's widget lives and has been shown; other backends always have."""
    # Qt deletes a widget while Python still holds it: any call raises RuntimeError then.
    with suppress(RuntimeError):
        valid = getattr(canvas.native, "isValid", None)
        return valid is None or bool(valid())
    return False


def forget_objects(context: Any) -> None:
    """Have a vispy context forget all GL objects, whose names mean nothing any more.

    Drawing with those made until now does nothing from here on, and is no error.
    """
    # A parser that knows the old names as deleted ignores them; an empty one would raise.
    before = context.shared.parser
    context.glir.clear()
    after = type(before)()
    after.parse([("CREATE", known, None) for known in list(getattr(before, "_objects", ()))])
    context.shared.parser = after


def build_anew(viewer: napari.Viewer, layers: Sequence[Layer]) -> bool:
    """Give layers new visuals in place of those they have; return whether all got theirs.

    Parameters
    ----------
    viewer : napari.Viewer
    layers : sequence of napari layers
    """
    qt_viewer = _qt_viewer(viewer)
    # Other versions of napari do this elsewhere; layers then stay as they are.
    try:
        canvas = qt_viewer.canvas
        fonts = canvas._font_info
        # Glyphs are textures too.
        canvas._font_info = replace(fonts, font_manager=type(fonts.font_manager)())
        for layer in layers:
            canvas._remove_layer(SimpleNamespace(value=layer))
            qt_viewer._add_layer(layer)
    except (AttributeError, KeyError, TypeError):
        return False
    return True


def pixel_scale(viewer: napari.Viewer) -> float:
    """Return the device pixels of a logical pixel of a viewer's canvas."""
    # vispy divides by the width, of which a narrow window leaves none to the canvas.
    with suppress(ZeroDivisionError):
        return float(getattr(native_canvas(viewer), "pixel_scale", 1.0))
    return 1.0


def zoom_by_click(viewer: napari.Viewer) -> Callable[..., None] | None:
    """Return napari's own among what a viewer calls at double clicks; None if it has gone."""
    callbacks = viewer.mouse_double_click_callbacks
    own = (c for c in callbacks if getattr(c, "__name__", "") == "double_click_to_zoom")
    return next(own, None)


def refresh_status(viewer: napari.Viewer) -> None:
    """Have the status bar say what layers say now.

    napari asks the active layer in a thread of its own as soon as the mouse moves, before our
    callbacks hear of it; its answer, of what was there before, comes after ours.
    """
    thread = getattr(native_window(viewer), "status_thread", None)
    # Other versions of napari ask at once, in the main thread.
    if thread is not None:
        thread.trigger_status_update()


def when_window_closes(viewer: napari.Viewer, callback: Callable[[], None]) -> Callable[[], None]:
    """Call back when the viewer's window is taken down; return what calls that off.

    Parameters
    ----------
    viewer : napari.Viewer
    callback : callable
        The window keeps its owner alive until then.
    """
    qt_window = native_window(viewer)
    if qt_window is None:
        return lambda: None

    def destroyed(*_: Any) -> None:
        callback()

    # A close may still be called off; only a destroyed window is gone.
    qt_window.destroyed.connect(destroyed)
    # What calls it off must not keep the window alive.
    known: Callable[[], Any] = ref(qt_window)

    def call_off() -> None:
        # Nothing is left to call off where the window has gone.
        with suppress(AttributeError, RuntimeError, TypeError):
            known().destroyed.disconnect(destroyed)

    return call_off


def keep_keyboard(viewer: napari.Viewer) -> None:
    """Have napari's notifications leave the keyboard where it is, for the life of the canvas.

    By itself each hands it to the canvas 4 s after it came: what is typed would be commands. The
    ones beneath one that ends go after another 4 s: by themselves they would stay for ever.
    """
    native = getattr(native_canvas(viewer), "native", None)
    if native is None:
        return
    from napari._qt.dialogs.qt_notification import NapariQtNotification as Toast
    from qtpy.QtWidgets import QApplication

    known: Callable[[], Any] = ref(native)

    def set_focus(*reason: Any) -> None:
        canvas, focused = known(), QApplication.focusWidget()
        toasts = {one for one in canvas.findChildren(Toast) if one.isVisible()}
        # One that ends leaves the list before it hands the keyboard on.
        left = toasts.intersection(Toast._instances)
        if left == toasts or focused is None or canvas.isAncestorOf(focused):
            type(canvas).setFocus(canvas, *reason)
        # The one beneath is looked for in that list as well, too late.
        for one in left if left != toasts else ():
            if one.timer.interval() and not (one.timer.isActive() or one.underMouse()):
                one.timer_start()

    native.setFocus = set_focus


class NothingToSlice(SlicingState):  # type: ignore[misc,valid-type]
    """Slicing state of a layer that is an image and has no slices."""

    def _set_view_slice(self) -> None:
        return None


class Table(Protocol):
    """A Points layer of objects, worked out when napari asks."""

    def points(self) -> NDArray[np.float64]:
        """Return (N, 3) centres, voxels z y x."""

    def state(self) -> dict[str, Any]:
        """Return what else the layer is told."""


class PictureLayer(Layer):
    """A napari layer that is an image of a session: nothing to slice, nothing to pick by voxel.

    Parameters
    ----------
    name : str
        Name in the layer list.
    spacing : (3,) array_like
        Voxel size of the session, mm z y x: the layer's scale unless placed otherwise.
    box : (2, 3) ndarray of float, optional
        First and last voxel along z, y, x: what the layer adds to the scene's extent. None adds
        nothing.
    **placement
        scale, translate, rotate, shear, affine, units: as every napari layer takes them.

    Notes
    -----
    To napari's writers and to **Duplicate** it is the `table` of its objects (None: of none): a
    Points layer with one point at each object's centre. Of napari's layer types that is the one no
    action of the layer list tries to convert, project or split.
    """

    frame_changed = Signal(object)
    refused = Signal(str)
    words = ""
    frame_now: Callable[[], Frame | None] = staticmethod(lambda: None)
    """Returns what the canvas would show if it were drawn now, a `view_camera.Frame` or None."""

    def __init__(
        self,
        name: str,
        spacing: ArrayLike,
        box: NDArray[np.float64] | None = None,
        **placement: Any,
    ) -> None:
        self.spacing = np.asarray(spacing, dtype=np.float64)
        self._frame: Frame | None = None
        self._drawing = False
        self._box = np.full((2, 3), np.nan) if box is None else np.asarray(box, dtype=float)
        self.table: Table | None = None
        # What napari calls while it makes a layer reads the fields above.
        super().__init__(None, 3, name=name, **{"scale": self.spacing, **placement})
        self._thumbnail_source: NDArray[np.float32] | None = None
        self.refresh()

    @property
    def axis_order(self) -> tuple[int, ...]:
        """Its data's axes z, y, x (0, 1, 2) as napari orders them, the one to the right last."""
        return tuple(int(axis) for axis in self._slice_input.order)

    @property
    def frame(self) -> Frame | None:
        """What the canvas showed when the layer was last drawn, a `view_camera.Frame` or None."""
        return self._frame

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the quads to draw, called at every draw."""
        if not frame.same_as(self._frame):
            # Set first: what hears of the frame asks the layer for it.
            self._frame, self._drawing = frame, True
            try:
                self.frame_changed.emit(frame)
            finally:
                self._drawing = False
        return ()

    def slice_quads_at(self, frame: SliceFrame) -> Sequence[Quad]:
        """Return the quads to draw upon a slice, in napari's 2D view; called at every draw."""
        return ()

    def repaint(self) -> None:
        """Ask to be drawn again; what is shown while it is drawn is seen at once."""
        # Asked for within a draw, it would draw for ever.
        if not self._drawing:
            self.events.refresh()

    @property
    def data(self) -> NDArray[np.float64]:
        """(N, 3) centres of this layer's objects, voxels z y x."""
        return np.zeros((0, 3)) if self.table is None else self.table.points()

    @data.setter
    def data(self, data: NDArray[np.float64]) -> None:
        """Refuse data.

        Raises
        ------
        AttributeError
            The layer follows its session.
        """
        raise AttributeError("this layer follows its session and cannot be given data")

    def set_picture(self, rgba: NDArray[np.float32] | None) -> None:
        """Set the image whose small copy stands in the layer list, premultiplied (H, W, 4)."""
        if rgba is not None:
            self._thumbnail_source = rgba
            self._update_thumbnail()

    @property
    def _type_string(self) -> str:
        return "points"

    @property
    def _extent_data(self) -> NDArray[np.float64]:
        return self._box

    @property
    def _extent_data_augmented(self) -> NDArray[np.float64]:
        # Voxels reach half a voxel beyond their centres.
        return self._box + np.array([[-0.5], [0.5]])

    def get_status(self, *args: Any, **kwargs: Any) -> dict[str, str]:
        """Say what the mouse is on, for napari's status bar.

        Parameters
        ----------
        *args, **kwargs
            Where the mouse is, as napari says it; not needed.
        """
        # Coordinates of a click into an image mean nothing.
        nothing = dict.fromkeys(("coordinates", "coords", "value"), "")
        return {**self._get_source_info(), "layer_base": self.words or self.name, **nothing}

    def _get_ndim(self) -> int:
        return 3

    def _get_state(self) -> dict[str, Any]:
        state = self._get_base_state()
        state.update(
            # Our blending is for premultiplied colours. Shown, the points would lie in the bag and
            # come to light one by one, where objects have left.
            {} if self.table is None else self.table.state(),
            projection_mode="none",
            visible=False,
            blending="translucent",
        )
        return state

    def _set_view_slice(self) -> None:
        return None

    def _get_value(self, position: Any) -> None:
        return None

    def _get_layer_slicing_state(self, data: Any, cache: bool) -> Any:
        # napari slices every layer when the view changes; there is nothing to read here.
        return NothingToSlice(self, data, cache)

    def _update_thumbnail(self) -> None:
        source = getattr(self, "_thumbnail_source", None)
        if source is None or min(source.shape[:2]) < 1:
            return
        height, width = self._thumbnail_shape[:2]
        # The whole image at one zoom; what it leaves free stays black.
        zoom = max(source.shape[0] / height, source.shape[1] / width)

        def nearest(of: int, to: int) -> tuple[Any, Any]:
            at = ((np.arange(to) - (to - 1) / 2) * zoom + (of - 1) / 2).round().astype(int)
            return at.clip(0, of - 1), (at >= 0) & (at < of)

        (rows, tall), (cols, wide) = map(nearest, source.shape, (height, width))
        small = source[np.ix_(rows, cols)] * (tall[:, None] & wide)[..., None]
        small[..., 3] = 1.0
        self.thumbnail = (np.clip(small, 0, 1) * 255).astype(np.uint8)


class PictureAdapter(VispyBaseLayer):  # type: ignore[misc,valid-type]
    """Between one of our layers and the vispy node that draws it.

    Parameters
    ----------
    layer : PictureLayer
    node : vispy.scene.VisualNode
        Draws it; must blend premultiplied colours by itself.
    **kwargs
        Whatever this napari hands to its visuals (fonts and the like).
    """

    def __init__(self, layer: Layer, node: Any, **kwargs: Any) -> None:
        super().__init__(layer, node, **kwargs)
        self.reset()

    @property
    def in_3d(self) -> bool:
        """Whether the layer is displayed in three dimensions."""
        return len(self.displayed) == 3

    @property
    def displayed(self) -> tuple[int, ...]:
        """The axes of the layer's data that are displayed, the one to the right last."""
        return tuple(int(axis) for axis in self.layer._slice_input.displayed)

    def stand(self) -> None:
        """Have the node stand among the axes that are displayed now."""
        # napari tells its own visuals of another order of axes as of other data.
        if self.displayed != self._stands_by:
            self._on_matrix_change()

    def _on_matrix_change(self, event: Any = None) -> None:
        self._stands_by = self.displayed
        super()._on_matrix_change()

    def _on_data_change(self, event: Any = None) -> None:
        self.stand()
        self.node.update()

    def _on_opacity_change(self, event: Any = None) -> None:
        self.node.opacity = self.layer.opacity
        self.node.update()

    def _on_blending_change(self, event: Any = None) -> None:
        # napari's modes expect straight alpha; the node's own state is for premultiplied.
        self.node.update()


def _controls(sentence: str) -> type[Any]:
    """Make the controls class of one layer class: opacity, and a sentence."""
    from qtpy.QtWidgets import QLabel, QSizePolicy

    class PictureControls(QtLayerControls):  # type: ignore[misc,valid-type]
        """Controls with what applies to an image: its opacity."""

        # Actions of another layer type: napari has none for ours, and looks them up by name.
        PAN_ZOOM_ACTION_NAME = "activate_tracks_pan_zoom_mode"
        TRANSFORM_ACTION_NAME = "activate_tracks_transform_mode"

        def __init__(self, layer: Layer) -> None:
            super().__init__(layer)
            for name in ("blend_combobox", "blend_label"):
                widget = getattr(self._opacity_blending_controls, name, None)
                # Blending is the node's own business; other versions of napari name it otherwise.
                if widget is not None:
                    widget.hide()
            # Our layers stand where the user's own do; moved alone they would lie beside them.
            self.transform_button.hide()
            words = QLabel(sentence)
            words.setWordWrap(True)
            # A label's hint grows with its text and would widen napari's left column.
            words.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Minimum)
            words.setMinimumWidth(0)
            self.layout().addRow(words)

    return PictureControls
