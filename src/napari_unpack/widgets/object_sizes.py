"""The extents of all objects along their own axes, measured in a worker where they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, Signal

from napari_unpack.tasks import Progress, Task
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.widgets.notifications import show_error
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session.placement import Bag

SLOT = "sizes of the objects"

Sizes = dict[int, tuple[float, ...]]


class ObjectSizes(QObject):
    """Measures the bag that is shown, once for each revision of its labels.

    Signals: `measured`, when `known` has become more.

    Parameters
    ----------
    workspace : Workspace
    parent : QObject, optional
    """

    measured = Signal()

    def __init__(self, workspace: Workspace, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._bag: Bag | None = None
        self._sizes: Sizes = {}
        workspace.switched.connect(self._forget)

    def known(self) -> Sizes:
        """Return the extents by ID in mm, longest first; empty until they are measured."""
        return self._sizes if self._shown() is self._bag else {}

    def want(self) -> None:
        """Measure what is not known; `measured` tells when it is."""
        session = self._workspace.session
        if session is None or session.bag is self._bag:
            return
        bag, ids = session.bag, session.ids
        self._bag, self._sizes = bag, {}
        task = Task(object(), lambda progress: extents(bag, ids, progress))
        take = partial(self._take, bag)
        self._workspace.scheduler.submit(task, Worker.LONG, take, failed=show_error, slot=SLOT)

    def _shown(self) -> Bag | None:
        session = self._workspace.session
        return None if session is None else session.bag

    def _take(self, bag: Bag, sizes: Sizes) -> None:
        # A repair may have made other objects meanwhile.
        if bag is self._bag:
            self._sizes = sizes
            self.measured.emit()

    def _forget(self) -> None:
        # It would keep the volume of a closed session alive.
        self._bag, self._sizes = None, {}


def extents(bag: Bag, ids: Sequence[int], progress: Progress) -> Sizes:
    """Return the extents of objects along their own axes, mm, longest first.

    Parameters
    ----------
    bag : Bag
    ids : sequence of int
    progress : callable
        Takes (fraction, text).
    """
    found: Sizes = {}
    for k, object_id in enumerate(ids):
        progress(k / len(ids), "Measuring objects")
        found[object_id] = tuple(float(edge) for edge in bag.oriented(object_id).size)
    return found
