"""Keys while the panel is open: on the viewer, and on our own layers, whose keys go first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from napari_unpack.widgets.repair_tools import RepairBench
from napari_unpack.widgets.reveal_box import Ways
from napari_unpack.widgets.workspace import Workbench

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


class Keys:
    """Bind the panel's keys; `close` gives every key back to whoever had it.

    Parameters
    ----------
    workbench : Workbench
    reveal : callable
        Asks what frees the selected object.
    ways : Ways
        Whose answer Escape puts away.
    repair : RepairBench
        Whose waiting for clicks Escape ends.
    """

    def __init__(
        self, workbench: Workbench, reveal: Callable[[], None], ways: Ways, repair: RepairBench
    ) -> None:
        self._bench, self._ways, self._repair = workbench, ways, repair
        self._bound: list[tuple[Any, str, Any]] = []
        self._on_stage: list[tuple[Any, str, Any]] = []
        self._actions: dict[str, Callable[[], None]] = {
            "N": workbench.unpack,
            "B": workbench.restore,
            "I": self._inspect,
            "H": self._hide,
            "R": reveal,
            "C": workbench.recolor,
            "Control-Z": workbench.undo,
            "Control-Shift-Z": workbench.redo,
            "Escape": self._escape,
        }
        workbench.staged.connect(self._follow_stage)
        self._follow_stage()

    def _follow_stage(self) -> None:
        """Hold the keys only while there is a stage to command."""
        self._release()
        stage = self._bench.stage
        if stage is None:
            return
        viewer = getattr(self._bench.viewer, "__wrapped__", self._bench.viewer)
        for owner in (viewer, *stage.layers):
            for key, act in self._actions.items():
                earlier = owner.bind_key(key, _ignoring_its_owner(act), overwrite=True)
                self._bound.append((owner, key, earlier))

    def _release(self) -> None:
        for owner, key, earlier in self._bound:
            owner.bind_key(key, earlier, overwrite=True)
        self._bound.clear()

    def close(self) -> None:
        """Give all keys back."""
        self._bench.staged.disconnect(self._follow_stage)
        self._release()

    def _selected(self) -> list[int]:
        session = self._bench.session
        return [] if session is None else sorted(session.selected)

    def _inspect(self) -> None:
        session = self._bench.session
        if session is None:
            return
        if any(state.name == "INSPECTED" for state in session.states.values()):
            self._bench.leave()
            return
        chosen = self._selected() or [
            i for i, state in session.states.items() if state.name == "UNPACKED"
        ]
        if chosen:
            self._bench.inspect(chosen[-1])

    def _hide(self) -> None:
        chosen = self._selected()
        if chosen:
            self._bench.hide(chosen)

    def _escape(self) -> None:
        session = self._bench.session
        stage = self._bench.stage
        if getattr(stage, "drawing", False):
            stage.drawing = False
            stage.events.drawn.emit()
        elif self._repair.awaits_clicks:
            self._repair.cancel()
        elif any(state.name == "INSPECTED" for state in session.states.values()):
            self._bench.leave()
        elif self._ways.shown:
            self._ways.forget()
        else:
            self._bench.leave_object()


def _ignoring_its_owner(act: Callable[[], None]) -> Callable[[Any], None]:
    def pressed(_owner: Any) -> None:
        act()

    return pressed
