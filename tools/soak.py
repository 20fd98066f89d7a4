"""Random commands at speed on the real plugin: it may neither leak nor err.

    VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh python tools/soak.py --seconds 3600

Every error counts, wherever it comes from: exceptions, also in threads and Qt's slots, what Qt
and vispy log, and the stage's own words on GL. Memory is what the process holds, looked at when
everything has been put away and what lies free was given back to the system (no leak can be);
the first third of the time is for warming up.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import logging
import sys
import tempfile
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import psutil
from napari.utils.notifications import notification_manager
from qtpy.QtCore import QCoreApplication, QEvent, QtMsgType, qInstallMessageHandler
from qtpy.QtWidgets import QApplication

WARM_UP = 1 / 3
FLAT = 0.05
HARMLESS = ("propagateSizeHints", "XDG_RUNTIME_DIR", "QStandardPaths", "Unable to set geometry")
"""What Qt says on virtual screens."""


@dataclass
class Report:
    """What a soak has found.

    Parameters
    ----------
    commands : Counter
        How often each was given.
    errors : list of str
    memory : list of (float, float)
        Seconds since the start, and megabytes held then.
    warm_up : float
        The part of the time after which growth counts.
    """

    commands: Counter[str] = field(default_factory=Counter)
    errors: list[str] = field(default_factory=list)
    memory: list[tuple[float, float]] = field(default_factory=list)
    warm_up: float = WARM_UP

    @property
    def growth(self) -> float:
        """How much more memory is held at the end than after warming up, as a share of it."""
        end = self.memory[-1][0]
        warm = [mb for at, mb in self.memory if at >= self.warm_up * end]
        third = max(1, len(warm) // 3)
        return float(np.median(warm[-third:]) / np.median(warm[:third]) - 1.0)

    def __str__(self) -> str:
        told = ", ".join(f"{name} {count}" for name, count in self.commands.most_common())
        held = " ".join(f"{mb:.0f}" for _, mb in self.memory)
        return "\n".join(
            [
                f"{self.commands.total()} commands: {told}",
                f"memory, MB: {held}; growth after warming up {self.growth:+.1%}",
                f"{len(self.errors)} errors",
                *self.errors[:10],
            ]
        )


@contextmanager
def caught(errors: list[str]) -> Iterator[None]:
    """Write down every error of the process."""

    def on_exception(kind: Any, value: Any, trace: Any) -> None:
        errors.append("".join(traceback.format_exception(kind, value, trace)))

    def on_qt(kind: Any, _context: Any, text: str) -> None:
        bad = kind in (QtMsgType.QtWarningMsg, QtMsgType.QtCriticalMsg, QtMsgType.QtFatalMsg)
        if bad and not any(part in text for part in HARMLESS):
            errors.append(f"Qt: {text}")

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            errors.append(f"{record.name}: {record.getMessage()}")

    listener = Listener(logging.ERROR)
    loggers = [logging.getLogger(name) for name in ("vispy", "napari")]
    hooks = sys.excepthook, threading.excepthook
    sys.excepthook = on_exception
    threading.excepthook = lambda a: on_exception(a.exc_type, a.exc_value, a.exc_traceback)
    before = qInstallMessageHandler(on_qt)
    for logger in loggers:
        logger.addHandler(listener)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(listener)
        qInstallMessageHandler(before)
        sys.excepthook, threading.excepthook = hooks


class Hand:
    """Gives random commands to a panel.

    Parameters
    ----------
    viewer : napari.Viewer
    panel : UnpackingWidget
        With its stage open.
    rng : numpy.random.Generator
    folder : Path
        For session files.
    """

    def __init__(self, viewer: Any, panel: Any, rng: np.random.Generator, folder: Path) -> None:
        self.viewer, self.panel, self.rng = viewer, panel, rng
        self.file = folder / "soak.unpack"
        workspace, commands = panel.workspace, panel.commands
        self.commands: dict[str, tuple[float, Callable[[], None]]] = {
            "unpack": (8, lambda: commands.unpack(int(rng.integers(1, 4)))),
            "restore": (5, lambda: commands.restore(int(rng.integers(1, 3)))),
            "restore all": (1, commands.restore_all),
            "unpack these": (2, lambda: commands.unpack(self.some())),
            "scrub": (4, lambda: commands.go_to(int(rng.integers(0, 8)))),
            "play": (2, panel.unpack.step_slider.play.click),
            "inspect": (2, lambda: commands.inspect(self.some()[0])),
            "leave": (2, commands.leave),
            "hide": (2, lambda: commands.hide(self.some())),
            "show": (2, lambda: commands.show(workspace.session.ids)),
            "isolate": (1, lambda: commands.isolate(self.some())),
            "recolor": (2, commands.recolor),
            "undo": (6, commands.undo),
            "redo": (4, commands.redo),
            "select": (3, lambda: commands.select(self.some())),
            "turn": (8, self.turn),
            "zoom": (3, self.zoom),
            "direction": (1, self.direct),
            "finish": (3, lambda: workspace.controller.finish()),
            "flat": (0.4, self.flatten),
            "density": (1, self.density),
            "save": (0.3, lambda: panel.files.save_to(self.file)),
            "open": (0.15, self.open),
        }

    def give(self) -> str:
        """Give one command; return which."""
        question = self.panel.unsaved.question
        if question is not None:
            question.button(question.StandardButton.Discard).click()
        names = list(self.commands)
        weights = np.array([weight for weight, _ in self.commands.values()])
        name = str(self.rng.choice(names, p=weights / weights.sum()))
        if self.panel.workspace.controller is not None:
            self.commands[name][1]()
        return name

    def some(self) -> list[int]:
        """Return one to three objects."""
        ids = np.array(self.panel.workspace.session.ids)
        return [int(i) for i in self.rng.permutation(ids)[: self.rng.integers(1, 4)]]

    def turn(self) -> None:
        """Turn the camera."""
        camera = self.viewer.scene.camera
        camera.angles = tuple(np.array(camera.angles) + self.rng.normal(0, 15, 3))

    def zoom(self) -> None:
        """Zoom, within limits."""
        camera = self.viewer.scene.camera
        camera.zoom = float(np.clip(camera.zoom * self.rng.uniform(0.8, 1.25), 0.5, 20))

    def direct(self) -> None:
        """Choose another direction."""
        ways = [None, "up", "+z", "-y", (0.2, -1.0, 0.4)]
        self.panel.workspace.session.direction = ways[self.rng.integers(len(ways))]

    def density(self) -> None:
        """Move a point of the transfer function."""
        from napari_unpack import TransferFunction

        session = self.panel.workspace.session
        opacity = float(self.rng.uniform(0.1, 0.6))
        session.transfer_function = TransferFunction([(0, 0), (400, 0.0), (3000, opacity)])

    def flatten(self) -> None:
        """Look at slices for a moment."""
        self.viewer.dims.ndisplay = 2 if self.viewer.dims.ndisplay == 3 else 3

    def open(self) -> None:
        """Open what was saved, in place of what is there."""
        if self.file.exists() and not self.panel.files.progress.running:
            self.panel.files.open_from(self.file)

    def dismiss(self) -> None:
        """Close napari's notices, which stay while its window is not in front, as here.

        A fifth of a megabyte each, they would hide what the plugin holds.
        """
        for widget in QApplication.allWidgets():
            if type(widget).__name__ == "NapariQtNotification":
                widget.close()
        # Without a main loop of Qt nobody else carries out what was put off.
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        notification_manager.records.clear()

    def put_away(self) -> None:
        """Bring everything to rest in the bag, so that memory can be compared."""
        workspace, commands = self.panel.workspace, self.panel.commands
        deadline = monotonic() + 60
        while self.panel.files.progress.running and monotonic() < deadline:
            QCoreApplication.processEvents()
        self.panel.unpack.step_slider.play.setChecked(False)
        self.dismiss()
        self.viewer.dims.ndisplay = 3
        if workspace.controller is not None:
            commands.show(workspace.session.ids)
            commands.go_to(0)
            workspace.controller.frame_bag()
            workspace.controller.settle(8)
        stale = [a for a in self.viewer.layers if not a.visible and "soak" in a.name]
        for layer in stale:
            if workspace.controller is None or layer not in workspace.controller.sources:
                self.viewer.layers.remove(layer.name)
        gc.collect()


def held() -> int:
    """Return the bytes that this process holds, without those that the C library keeps in stock.

    That stock grows for minutes and then stays, by as much as a fifth, whatever a program does.
    """
    give_back = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if give_back is not None:
        give_back(0)
    return int(psutil.Process().memory_info().rss)


def soak(
    viewer: Any,
    panel: Any,
    seconds: float,
    seed: int = 0,
    samples: int = 20,
    pause: float = 0.01,
    fewest: int = 0,
    told: Callable[[Report], None] = lambda _: None,
) -> Report:
    """Give random commands for so long.

    Parameters
    ----------
    viewer, panel
        With a stage open.
    seconds : float
        Of commands; putting everything away before memory is looked at comes on top. 0 for
        `fewest` commands, however quick they are.
    seed : int
    samples : int
        How often memory is looked at.
    pause : float
        Between commands, s; events are handled meanwhile.
    fewest : int
        Commands, however long they take: a slow machine has not warmed up after few.
    told : callable
        Is given the report so far whenever memory was looked at.

    Returns
    -------
    Report
    """
    report = Report()
    with caught(report.errors), tempfile.TemporaryDirectory() as folder:
        hand = Hand(viewer, panel, np.random.default_rng(seed), Path(folder))
        start = monotonic()
        for sample in range(1, samples + 1):
            enough = monotonic() + seconds / samples
            while monotonic() < enough or report.commands.total() * samples < fewest * sample:
                try:
                    report.commands[hand.give()] += 1
                except Exception:
                    report.errors.append(traceback.format_exc())
                until = monotonic() + pause
                QCoreApplication.processEvents()
                while monotonic() < until:
                    QCoreApplication.processEvents()
                    sleep(pause / 10)
            hand.put_away()
            report.memory.append((monotonic() - start, held() / 2**20))
            told(report)
        # Errors that wait in Qt's queue count too.
        QCoreApplication.processEvents()
    return report


def _say(report: Report) -> None:
    passed, megabytes = report.memory[-1]
    print(
        f"[soak] {passed / 60:.0f} min: {report.commands.total()} commands, "
        f"{len(report.errors)} errors, {megabytes:.0f} MB",
        flush=True,
    )


def main() -> int:
    """Soak a simulated bag in a viewer of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    import napari

    from napari_unpack import Session, simulate_bag
    from napari_unpack.widgets.unpacking_widget import UnpackingWidget

    bag = simulate_bag(seed=2, shape=(64, 72, 96), count=12)
    viewer = napari.Viewer(show=True)
    viewer.window.resize(900, 640)
    panel = UnpackingWidget(viewer)
    viewer.window.add_dock_widget(panel, name="Virtual Unpacking", area="right")
    panel.workspace.open(Session(bag.volume, bag.labels, bag.spacing, bag.objects))
    panel.workspace.controller.seconds = 0.2
    panel.workspace.controller.settle(60)
    report = soak(viewer, panel, chosen.seconds, chosen.seed, told=_say)
    print(report)
    # Nothing of it is worth restoring.
    panel.unsaved.give_up()
    panel.end()
    viewer.close()
    return int(bool(report.errors) or report.growth > FLAT)


if __name__ == "__main__":
    sys.exit(main())
