"""Who leaves first along D, found by moving the foremost objects alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

from napari_unpack.geometry.axes import Vector
from napari_unpack.session.inquiry import SessionInquiry
from napari_unpack.session.state import SessionState
from napari_unpack.session.validation import checked_ids
from napari_unpack.unpacking.blocking_graph import leading_groups

Group = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class NextUnpackable:
    """Enough of the answer who is free to carry out one command.

    Parameters
    ----------
    question : GlimpseQuestion
        What was asked.
    groups : tuple of tuple of int
        Who can leave, in the order of the queue.
    seconds : float
        What it took.
    """

    question: GlimpseQuestion
    groups: tuple[Group, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class GlimpseQuestion:
    """The question who leaves first along D.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    packed : frozenset of int
        Objects in the bag.
    wanted : frozenset of int, optional
        Those asked about; None where it is about whoever is next.
    order : tuple of int
        Whom to ask about, one after the other.
    count : int
        How many objects are to leave.
    most : int
        Objects in a group.
    ready : callable
        Makes ready and returns what `leading_groups` asks for blockers.
    terms : tuple
        The rules it is asked with.
    edition : int
        Of the labels.
    """

    direction: Vector
    packed: frozenset[int]
    wanted: frozenset[int] | None
    order: Group
    count: int
    most: int
    ready: Callable[[], Callable[[int, int], frozenset[int]]]
    terms: tuple[object, ...]
    edition: int

    def answer(
        self, seconds: float = float("inf"), clock: Callable[[], float] = perf_counter
    ) -> NextUnpackable | None:
        """Move objects, foremost first, until enough are found; may run on any thread.

        Parameters
        ----------
        seconds : float
            No further object is moved after so long.
        clock : callable
            Returns the time in seconds.

        Returns
        -------
        NextUnpackable or None
            None where the time did not suffice or fewer can leave than are to.
        """
        start = clock()
        blockers = self.ready()

        def in_time(object_id: int, most: int) -> frozenset[int]:
            if clock() - start > seconds:
                raise TimeoutError
            return blockers(object_id, most)

        found: list[Group] = []
        groups = leading_groups(self.order, in_time, self.most)
        try:
            while sum(map(len, found)) < self.count:
                found.append(next(groups))
        except (StopIteration, TimeoutError):
            return None
        return NextUnpackable(self, tuple(found), clock() - start)


class SessionGlimpses(SessionInquiry):
    """What is enough to go on with while the whole answer for a new direction is on its way.

    Notes
    -----
    Who is free by the rule "exact" without tolerance is decided by moving an object's voxels,
    and the queue is ordered by where objects lie: neither needs all of them. The one found
    first is the one that stands first in the queue of the whole answer.
    """

    _glimpse: NextUnpackable | None = None

    def glimpse_question(self, n_or_ids: int | Iterable[int] = 1) -> GlimpseQuestion | None:
        """Return the question that is enough to unpack so many or these.

        None where the whole answer is known, or by the rules is needed. Hand the result of its
        `answer()` to `accept_glimpse`.

        Raises
        ------
        ValueError
            If an ID is unknown.
        """
        probe, packed = self.casters.probe, self._packed(self._situation)
        queue, direction = self._situation.queue, self.unpack_direction
        if probe is None or self.criterion != ("exact", 0.0):
            return None
        if self._answer is not None and self._answer.serves(direction, packed):
            return None
        key = queue.precedence(self.bag.depths(direction))
        wanted, count, most = None, 1, self.max_group_size
        if isinstance(n_or_ids, int):
            if queue.serves(direction, packed, self._terms):
                return None
            order, count = sorted(packed, key=key), n_or_ids
        else:
            wanted = packed.intersection(checked_ids(n_or_ids, self._known, "n_or_ids"))
            order, count, most = sorted(wanted), len(wanted), 1
        if not order:
            return None
        visible, boxes = self._table(packed), self.boxes

        def ready() -> Callable[[int, int], frozenset[int]]:
            blockers = probe(direction, visible)
            return lambda i, most: blockers(i, boxes.slices(i), most)

        return GlimpseQuestion(
            direction, packed, wanted, tuple(order), count, most, ready, self._terms, self._edition
        )

    def accept_glimpse(self, glimpse: NextUnpackable) -> bool:
        """Keep an answer for the command that follows; return False where it is out of date."""
        asked = glimpse.question
        fits = asked.edition == self._edition and asked.terms == self._terms
        if not fits or not self._shows(glimpse, self._situation):
            return False
        self._glimpse = glimpse
        return True

    def _seen(self, situation: SessionState, count: int) -> NextUnpackable | None:
        """Return the glimpse of who is next, if it holds and so many are in it."""
        known = self._glimpse
        if known is None or known.question.wanted is not None or not self._shows(known, situation):
            return None
        return known if sum(map(len, known.groups)) >= count else None

    def _seen_free(self, situation: SessionState, wanted: frozenset[int]) -> NextUnpackable | None:
        """Return the glimpse that tells of chosen objects that each of them is free."""
        known = self._glimpse
        if known is None or known.question.wanted != wanted or not self._shows(known, situation):
            return None
        return known

    def _shows(self, glimpse: NextUnpackable, situation: SessionState) -> bool:
        asked = glimpse.question
        same = abs(asked.direction - self.unpack_direction).max() <= 1e-6
        return bool(same) and asked.packed == self._packed(situation)
