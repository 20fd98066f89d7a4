"""Keys while the panel is open: on the viewer, and on our own layers, whose keys go first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.reveal_box import RevealPlanner
from napari_unpack.widgets.workspace import Workspace

KEYS = (
    ("N", "next"),
    ("B", "back"),
    ("I", "inspect"),
    ("R", "reveal"),
    ("H", "hide"),
    ("C", "recolour"),
    ("Ctrl+Z", "undo"),
    ("Ctrl+Shift+Z", "redo"),
    ("Esc", "leave, call off"),
)
MOUSE = (
    ("Drag", "turns the bag; on a sprite, that object"),
    ("Shift+drag", "on a sprite moves it"),
    ("Double click", "on a sprite studies it alone"),
    ("Click", "selects; with Alt, what is behind"),
    ("Wheel", "zooms everything"),
)


def help_text() -> str:
    """Return keys and mouse as rich text: the keys in lines that break between them only."""
    keys = " · ".join(f"<b>{key}</b>\u00a0{what}" for key, what in KEYS)
    mouse = "".join(f"<br><b>{how}</b> {what}" for how, what in MOUSE)
    return keys + mouse


class Shortcuts:
    """Bind the panel's keys; `close` gives every key back to whoever had it.

    Parameters
    ----------
    workspace : Workspace
    reveal : callable
        Asks what frees the selected object.
    ways : RevealPlanner
        Whose answer Escape puts away.
    repair : RepairTools
        Whose waiting for clicks Escape ends.
    """

    def __init__(
        self,
        workspace: Workspace,
        reveal: Callable[[], None],
        ways: RevealPlanner,
        repair: RepairTools,
    ) -> None:
        self._workspace, self._ways, self._repair = workspace, ways, repair
        self._bound: list[tuple[Any, str, Any]] = []
        self._on_controller: list[tuple[Any, str, Any]] = []
        self._actions: dict[str, Callable[[], None]] = {
            "N": workspace.unpack,
            "B": workspace.restore,
            "I": self._inspect,
            "H": self._hide,
            "R": reveal,
            "C": workspace.recolor,
            "Control-Z": workspace.undo,
            "Control-Shift-Z": workspace.redo,
            "Escape": self._escape,
        }
        workspace.staged.connect(self._follow_controller)
        self._follow_controller()

    def _follow_controller(self) -> None:
        """Hold the keys only while there is a stage to command."""
        self._release()
        controller = self._workspace.controller
        if controller is None:
            return
        viewer = getattr(self._workspace.viewer, "__wrapped__", self._workspace.viewer)
        for owner in (viewer, *controller.layers):
            for key, act in self._actions.items():
                earlier = owner.bind_key(key, _ignoring_its_owner(act), overwrite=True)
                self._bound.append((owner, key, earlier))

    def _release(self) -> None:
        for owner, key, earlier in self._bound:
            owner.bind_key(key, earlier, overwrite=True)
        self._bound.clear()

    def close(self) -> None:
        """Give all keys back."""
        self._workspace.staged.disconnect(self._follow_controller)
        self._release()

    def _selected(self) -> list[int]:
        session = self._workspace.session
        return [] if session is None else sorted(session.selected)

    def _inspect(self) -> None:
        session = self._workspace.session
        if session is None:
            return
        if any(state.name == "INSPECTED" for state in session.states.values()):
            self._workspace.leave()
            return
        chosen = self._selected() or [
            i for i, state in session.states.items() if state.name == "UNPACKED"
        ]
        if chosen:
            self._workspace.inspect(chosen[-1])

    def _hide(self) -> None:
        chosen = self._selected()
        if chosen:
            self._workspace.hide(chosen)

    def _escape(self) -> None:
        session = self._workspace.session
        controller = self._workspace.controller
        if getattr(controller, "drawing", False):
            controller.drawing = False
            controller.events.drawn.emit()
        elif self._repair.awaits_clicks:
            self._repair.cancel()
        elif any(state.name == "INSPECTED" for state in session.states.values()):
            self._workspace.leave()
        elif self._ways.shown:
            self._ways.forget()
        else:
            self._workspace.leave_object()


def _ignoring_its_owner(act: Callable[[], None]) -> Callable[[Any], None]:
    def pressed(_owner: Any) -> None:
        act()

    return pressed
