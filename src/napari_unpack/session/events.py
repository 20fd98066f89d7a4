"""What a session tells those who listen, and the record of removals (the paper's figure 7)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from psygnal import Signal, SignalGroup

if TYPE_CHECKING:
    from napari_unpack.session.state import SessionState


class SessionEvents(SignalGroup):
    """Signals of a session.

    Each is emitted after the change, from the thread that made it.
    """

    states = Signal(frozenset, description="IDs whose state, pose or name changed")
    labels = Signal(frozenset, description="IDs that came, went or have other voxels now")
    hues = Signal(dict, description="{id: hue}, all of them; own colours changed too")
    transfer_function = Signal(object, description="the new TransferFunction")
    queue = Signal(tuple, description="IDs that can leave, the next one first")
    view = Signal(object, description="the new Camera")
    surroundings = Signal(object, description="the new decorations: background, box, scale")
    selected = Signal(frozenset, description="IDs selected")
    measurements = Signal(tuple, description="all of them, after one was made or removed")
    review = Signal(tuple, description="all answers, after one was given or undone")
    message = Signal(str, description="a sentence for the user")

    def emit_changes(
        self,
        before: SessionState,
        after: SessionState,
        edited: frozenset[int],
        states: Iterable[int],
    ) -> None:
        """Tell how one state differs from another.

        Parameters
        ----------
        before, after : SessionState
        edited : frozenset of int
            Objects whose voxels changed.
        states : iterable of int
            Objects whose `ObjectState` changed, and others to be told with them.
        """
        old, new = before.placements, after.placements
        changed = {*states, *(i for i in new if old.get(i) is not new[i])}
        # Widgets show names, styles and marks beside states, and listen to this alone.
        changed |= {i for i, _ in after.names.items() ^ before.names.items()}
        changed |= {i for i, _ in after.styles.items() ^ before.styles.items()}
        changed |= {i for i, _ in after.notes.items() ^ before.notes.items()}
        changed |= {i for i, _ in after.flags.items() ^ before.flags.items()}
        changed |= after.examples ^ before.examples
        # First: those who hear of the others look objects up in what they keep of the labels.
        if edited:
            self.labels.emit(edited)
        if after.hues is not before.hues or after.colors != before.colors:
            self.hues.emit(dict(after.hues))
        # Clipping has no signal of its own: who draws must cast anew, as for other opacities.
        if after.transfer_function is not before.transfer_function or after.cut is not before.cut:
            self.transfer_function.emit(after.transfer_function)
        if changed:
            self.states.emit(frozenset(changed))
        if after.measurements is not before.measurements:
            self.measurements.emit(after.measurements)
        if after.answers is not before.answers:
            self.review.emit(after.answers)
        if after.queue is not before.queue or after.direction != before.direction:
            self.queue.emit(after.queue.ids)


@dataclass(frozen=True)
class LogEntry:
    """One removal, for the paper's figure 7.

    Parameters
    ----------
    event : {"query run", "queue reuse"}
        Whether rays were cast for it.
    ids : tuple of int
        What left.
    packed : int
        Objects in the bag before.
    ratio : float
        Occlusion ratio (`first_hit`): 0 but where the least occluded object was taken.
    seconds : float
        What the query took; 0 for reuse.
    """

    event: str
    ids: tuple[int, ...]
    packed: int
    ratio: float
    seconds: float
