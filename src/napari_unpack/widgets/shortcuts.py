"""Keys while the panel is open: on the viewer, and on layers, whose keys go first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from napari_unpack.layers.compat import unwrap
from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets import notifications
from napari_unpack.widgets.commands import Commands, objects_in
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.view_box import FIT_KEY, VIEWS
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    import napari
    from napari.layers import Labels, Layer

    from napari_unpack.viewer.controller import SessionController

    KeyAction = Callable[[object], None]

# As elsewhere from pane to pane; napari's own order of Tab ends at the sliders of its slices.
PANE_KEY = "F6"

KEYS = (
    ("N", "unpack next"),
    ("B", "restore last"),
    ("I", "inspect"),
    ("R", "reveal"),
    ("H", "hide"),
    ("C", "recolour"),
    ("Delete", "delete the selected"),
    ("T", "show names"),
    ("M", "measure a length"),
    ("A", "measure an angle"),
    ("S, D, X, K", "in a review: same, different, not an object, skip"),
    ("Ctrl+Z", "undo"),
    ("Ctrl+Shift+Z", "redo"),
    (FIT_KEY, "fit"),
    ("1…7", "view from a side"),
    ("Shift+arrows", "turn the bag or the inspected object"),
    ("+, −", "zoom"),
    ("Ctrl+arrows", "move the view"),
    ("Ctrl+Shift+arrows", "move the selected sprite"),
    ("Arrows, Enter", "after Draw…: turn the arrow, take it"),
    ("Escape", "leave, cancel or select nothing"),
    (PANE_KEY, "3D view, panel, table, slices in turn; with Shift, back"),
)
MOUSE = (
    ("Drag", "turns the bag, or the sprite under the mouse"),
    ("Shift+drag", "moves a sprite"),
    ("Drag", "the cutting plane's arrow to push it, its rim to turn it"),
    ("Double click", "inspects an object, in the bag or beside it"),
    ("Click", "selects; with Ctrl or Shift, several; with Alt, the object behind"),
    ("Ctrl+drag", "selects what it encloses, in slices too"),
    ("Wheel", "zooms"),
)
# What of it holds in napari's 2D view of a layer that is not the plugin's.
IN_SLICES = (
    "In slices the keys of your active layer go first, but for Ctrl+Z, Ctrl+Shift+Z and Escape; "
    "while the keyboard is in the panel, only its 1…7 and F."
)


def help_text() -> str:
    """Return keys and mouse as rich text: the keys in lines that break between them only."""
    keys = " · ".join(f"<b>{key}</b>\u00a0{what}" for key, what in KEYS)
    mouse = "".join(f"<br><b>{how}</b> {what}" for how, what in MOUSE)
    return f"{keys}{mouse}<br>{IN_SLICES}"


# Pixels of a drag that turns by 15 degrees, which is what one press of an arrow key does.
ARROW = 24.0
TURNS = {
    "Shift-Left": (0.0, -ARROW),
    "Shift-Right": (0.0, ARROW),
    "Shift-Up": (-ARROW, 0.0),
    "Shift-Down": (ARROW, 0.0),
}
# A few presses for what the wheel does; with Shift, where plus is above another sign.
ZOOM_STEP = 1.25
ZOOMS = {"+": ZOOM_STEP, "Shift-+": ZOOM_STEP, "=": ZOOM_STEP, "-": 1.0 / ZOOM_STEP}
MOVES = {f"Control-{key}": way for key, way in TURNS.items()}
# Of the visible height.
GLANCE = 0.1
GLANCES = {
    "Control-Left": (0.0, -GLANCE),
    "Control-Right": (0.0, GLANCE),
    "Control-Up": (-GLANCE, 0.0),
    "Control-Down": (GLANCE, 0.0),
}
# On a layer of the user's these are napari's own wherever the keyboard is: its tools.
TOOLS = frozenset({*VIEWS, FIT_KEY})
# In which Escape gives up what the mouse draws on a Labels layer.
DRAWING_MODES = frozenset({"paint", "erase", "polygon"})
# While a direction is drawn; at any other time these keys are napari's own.
SIDES = {"Left": (0.0, -1.0), "Right": (0.0, 1.0), "Up": (-1.0, 0.0), "Down": (1.0, 0.0)}


class Shortcuts:
    """Bind the panel's keys; `close` gives every key back to its earlier action.

    Parameters
    ----------
    workspace : Workspace
    commands : Commands
    planner : RevealPlanner
        Its plan is dismissed by Escape.
    repair : RepairTools
        It deletes, and is called off by undo.
    others : mapping of str to callable
        Further keys, as napari writes them, and what each does.
    """

    def __init__(
        self,
        workspace: Workspace,
        commands: Commands,
        planner: RevealPlanner,
        repair: RepairTools,
        others: Mapping[str, Callable[[], None]],
    ) -> None:
        self._workspace, self._commands = workspace, commands
        self._planner, self._repair = planner, repair
        self._bound: list[tuple[napari.Viewer | Layer, str, _Pressed]] = []
        self._bound_on_sources: list[tuple[napari.Viewer | Layer, str, _Pressed]] = []
        self._inside = False
        self._actions: dict[str, Callable[[], None]] = {
            "N": commands.unpack,
            "B": commands.restore,
            "I": commands.toggle_inspection,
            "H": commands.hide_selected,
            "R": planner.reveal_selected,
            "C": commands.recolor,
            "Delete": repair.delete_selected,
            # The key that is called delete on a Mac.
            "Backspace": repair.delete_selected,
            "Control-Z": self._undo,
            "Control-Shift-Z": commands.redo,
            "Escape": self._escape,
            FIT_KEY: commands.fit,
            **{key: partial(commands.look_from, side) for key, (_, side) in VIEWS.items()},
            **{key: partial(self._turn, way) for key, way in TURNS.items()},
            **{key: partial(self._zoom, factor) for key, factor in ZOOMS.items()},
            **{key: partial(self._look, way) for key, way in GLANCES.items()},
            **{key: partial(self._move, way) for key, way in MOVES.items()},
            **others,
        }
        settings = commands.settings
        self._while_drawing: dict[str, Callable[[], None]] = {
            **{key: partial(settings.turn_arrow, way) for key, way in SIDES.items()},
            "Enter": settings.take_arrow,
            "Shift-Enter": partial(settings.take_arrow, along_normal=True),
        }
        workspace.switched.connect(self.bind)
        self.bind()

    def bind(self) -> None:
        """Bind the keys that could act now: none without a session, more while drawing."""
        _release(self._bound)
        controller = self._workspace.controller
        if controller is not None:
            # The active layer gets a key first, and one of ours is active in 3D.
            for owner in (unwrap(self._workspace.viewer), *controller.layers):
                self._bound += _bind_on(owner, self._acting(controller))
        self._bind_on_sources()

    def _bind_on_sources(self) -> None:
        """Bind the keys of the user's layers, which keep theirs for a hand that paints."""
        _release(self._bound_on_sources)
        controller, painted = self._workspace.controller, self._repair.painted
        if controller is None:
            return
        actions = self._acting(controller) if self._inside else {}
        kept = {key: act for key, act in actions.items() if key not in TOOLS}
        for layer in dict.fromkeys((*controller.sources, *painted)):
            own = self._on_labels(layer) if layer in painted else {}
            self._bound_on_sources += _bind_on(layer, kept | own)

    def _acting(self, controller: SessionController) -> dict[str, Callable[[], None]]:
        drawing = controller.interaction.pencil.drawing
        return self._actions | (self._while_drawing if drawing else {})

    def follow_keyboard(self, inside: bool) -> None:
        """Let the panel's keys go before those of the user's layers, or after them.

        Parameters
        ----------
        inside : bool
            Whether the keyboard is in the panel or in one of its docks.
        """
        if inside != self._inside:
            self._inside = inside
            self._bind_on_sources()

    def _on_labels(self, layer: Labels) -> dict[str, Callable[[], None]]:
        """Return what goes before a Labels layer's own keys, also for a hand that paints."""

        def undo() -> None:
            # napari's own would put back numbers of before a repair that came after the stroke.
            if layer not in self._repair.painted:
                layer.undo()
            elif not self._repair.comparing:
                self._undo()
            elif not self._repair.take_back(layer):
                self._repair.once_done(self._commands.undo)

        def redo() -> None:
            if self._repair.comparing or layer not in self._repair.painted:
                layer.redo()
            else:
                self._commands.redo()

        def escape() -> None:
            known = {str(key): act for key, act in type(layer).class_keymap.items()}
            if layer.mode in DRAWING_MODES and "Escape" in known:
                known["Escape"](layer)
            else:
                self._escape()

        return {"Control-Z": undo, "Control-Shift-Z": redo, "Escape": escape}

    def close(self) -> None:
        """Give all keys back."""
        self._workspace.switched.disconnect(self.bind)
        _release(self._bound)
        _release(self._bound_on_sources)

    def _undo(self) -> None:
        """Take back what was done last, also where it is still being worked out."""
        if not self._repair.call_off():
            self._commands.undo()

    def _turn(self, way: tuple[float, float]) -> None:
        from napari_unpack.viewer.interaction import drag_rotation

        if self._workspace.controller is not None:
            self._workspace.controller.framing.turn_by(drag_rotation(np.array(way)))

    def _zoom(self, factor: float) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.framing.zoom_by(factor)

    def _look(self, way: tuple[float, float]) -> None:
        if self._workspace.controller is not None:
            self._workspace.controller.framing.move_by(*way)

    def _move(self, way: tuple[float, float]) -> None:
        controller = self._workspace.controller
        if controller is None:
            return
        held, session = controller.renderer.held, controller.session
        out = objects_in(session, ObjectState.UNPACKED)
        # The last unpacked one is what the user has just looked at.
        chosen = [i for i in out if i in session.selected or not session.selected]
        if chosen:
            controller.interaction.move(chosen[-1], np.array(way))
            held.moved(chosen[-1])
        elif session.selected:
            notifications.inform("Only unpacked objects can be moved: unpack it first.")

    def _escape(self) -> None:
        """End what was begun last."""
        controller = self._workspace.controller
        if controller is None:
            return
        # The order is from what lasts shortest to what lasts longest.
        if controller.interaction.pencil.drawing:
            controller.interaction.pencil.stop()
        elif controller.interaction.tool is not None:
            controller.interaction.tool.cancel()
        elif objects_in(controller.session, ObjectState.INSPECTED):
            self._commands.leave()
        elif self._planner.plan is not None:
            self._planner.forget()
        elif controller.session.selected:
            self._commands.select(())
        else:
            self._commands.leave_container()


@dataclass(frozen=True, eq=False)
class _Pressed:
    """What a key of ours does.

    Parameters
    ----------
    act : callable
    earlier : callable, optional
        What the key did before; None for nothing of this owner's.
    """

    act: Callable[[], None]
    earlier: KeyAction | None
    # napari's own buttons look for their actions among the keys by it.
    __name__ = "pressed"

    def __call__(self, _owner: object) -> None:
        # napari calls a key's action with the viewer or layer that it is bound to.
        self.act()


def _bind_on(
    owner: napari.Viewer | Layer, actions: Mapping[str, Callable[[], None]]
) -> Iterator[tuple[napari.Viewer | Layer, str, _Pressed]]:
    for key, act in actions.items():
        earlier = owner.bind_key(key, None, overwrite=True)
        if isinstance(earlier, _Pressed):
            # Of the panel of another window, which may be closed before this one.
            earlier = earlier.earlier
        pressed = _Pressed(act, earlier)
        owner.bind_key(key, pressed, overwrite=True)
        yield owner, key, pressed


def _release(bound: list[tuple[napari.Viewer | Layer, str, _Pressed]]) -> None:
    """Give keys back, but for those that somebody has bound since."""
    for owner, key, pressed in bound:
        # None as the earlier action unbinds the key.
        now = owner.bind_key(key, pressed.earlier, overwrite=True)
        if now is not pressed:
            owner.bind_key(key, now, overwrite=True)
    bound.clear()
