"""What is derived from a session, each kind under the key it depends on, so never out of date.

What takes longer than a moment has a task, for any thread, whose result `store` keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from napari_unpack.appearance.tints import nearest_hue
from napari_unpack.geometry.axes import Vector, triple
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.session import colors
from napari_unpack.session.cache import ResultCache
from napari_unpack.session.colors import HuesKey, Identity, VisibilityKey
from napari_unpack.session.commands import Removal, RemovalPlan
from napari_unpack.session.directions import (
    MOST_SURVEY_RAYS,
    DirectionSurvey,
    RevealKey,
    RevealResult,
    SurveyKey,
    find_reveal_plan,
    find_survey,
    resolved,
)
from napari_unpack.session.errors import (
    NOTHING_UNPACKABLE,
    BlockedError,
    NobodyFreeError,
    NoTableError,
    listed_objects,
    share_of,
)
from napari_unpack.session.labels import Edit, LabelData
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.session.occlusion import (
    NextUnpackable,
    NextUnpackableKey,
    OcclusionInputs,
    OcclusionKey,
    OcclusionResult,
    find_next_unpackable,
    in_turn,
    view_along,
)
from napari_unpack.session.query_keys import BagUpKey, LabelsKey, SlotsKey, StatesKey
from napari_unpack.session.state import Group, Placement, SessionState
from napari_unpack.tasks import Progress, Task, no_progress
from napari_unpack.unpacking import Queue, Slots, arrange, bag_up, oriented_box, room_for
from napari_unpack.unpacking.direction_survey import BestDirection, RevealPlan, best_direction

if TYPE_CHECKING:
    import networkx as nx

    from napari_unpack.session.document import Document


class Queries:
    """What is derived from a session; each is worked out once for each key.

    Parameters
    ----------
    session : Document
    stored : callable
        Called after `store` has kept a result on occlusion that serves.

    Notes
    -----
    A task has frozen inputs, so that its result always fits its key, whatever has happened to
    the session meanwhile.
    """

    def __init__(self, session: Document, stored: Callable[[], object]) -> None:
        self._session, self._stored = session, stored
        self._cache = ResultCache()
        # Set by a window, which asks anew while nothing moves: the queue does not wait for that.
        self.asks_at_rest = False

    def store(self, task: Task[Any], result: Any) -> bool:
        """Keep the result of a task of these queries; return False where it no longer serves.

        Parameters
        ----------
        task : Task
        result : object
            None, from a task whose time did not suffice, serves nothing.
        """
        if result is None:
            return False
        learnt = result.learnt if isinstance(result, RevealResult) else ()
        if learnt:
            # They have keys of their own, and must not live on with the plan as well.
            result = replace(result, learnt=())
        for key, found in (*learnt, (task.key, result)):
            if not (isinstance(key, OcclusionKey) and self._is_late(key)):
                self._keep(key, found)
        # What serves no more is kept all the same: one may come back to that D or that step.
        serves = self._serves(task.key)
        if serves and isinstance(task.key, OcclusionKey):
            self._stored()
        return serves

    def _is_late(self, key: OcclusionKey) -> bool:
        """Tell whether a better result than one under this key was found meanwhile."""
        now = self._occlusion_key()
        known = self._known_occlusion(now) if key.same_question(now) else None
        return known is not None and not now.packed <= key.packed <= known.packed

    def _keep(self, key: Hashable, found: object) -> None:
        match key:
            case OcclusionKey():
                # The fewer are packed, the more of the result is swept and not left to rays, so
                # the latest is the finer one, also after some of it have come back.
                self._cache.keep(key, found, replaces=OcclusionKey.gives_way)
            case LabelsKey() | SurveyKey():
                # Volumes, and 26 tables of all pairs of objects: one of each is large enough.
                self._cache.keep(key, found, most=1)
            case _:
                self._cache.keep(key, found)

    def _serves(self, key: Hashable) -> bool:
        match key:
            case OcclusionKey():
                return key.covers(self._occlusion_key())
            case NextUnpackableKey():
                return key.covers(self._next_key(key.chosen, key.count))
            case SurveyKey():
                return key.covers(self._survey_key())
            case RevealKey():
                return key.near.equals(self._occlusion_key())
            case HuesKey():
                return key == self._hues_key()
            case LabelsKey():
                return key.fits(self._session.label_data)
        return False

    # What objects can leave along D.

    @property
    def packed(self) -> frozenset[int]:
        """Objects that stand in the way of others; see `SessionState.packed`."""
        return self._session.state.packed(self._session.label_data.known)

    @property
    def direction(self) -> Vector:
        """D now: unit vector in world, along which objects leave."""
        session = self._session
        return resolved(session.state.direction, session.view_state.camera, self.bag_up)

    def occlusion(
        self,
        direction: Vector | None = None,
        packed: frozenset[int] | None = None,
        afresh: bool = False,
        finer: bool = True,
        sure: Iterable[int] = (),
    ) -> OcclusionResult:
        """Return what can leave, and what blocks what; casts rays where that is not known.

        Parameters
        ----------
        direction : (3,) ndarray of float64, optional
            By default D.
        packed : frozenset of int, optional
            By default what is packed now.
        afresh, finer : bool
            A result for more packed objects does not do; finer: not unless it would be found again.
        sure : iterable of int
            Packed objects of which the voxels are to say all that must leave before them.
        """
        key = self._occlusion_key(direction, packed)
        known = None if afresh else self._known_occlusion(key, finer)
        known = known or self._cache.find(key, OcclusionKey.equals)
        if known is None or not known.is_swept(sure, key.packed):
            task = self._occlusion_inputs().task(key, known, sure)
            known = task.run(no_progress)
            self._keep(task.key, known)
        return known

    def occlusion_task(
        self, finer: bool = False, sure: Iterable[int] = ()
    ) -> Task[OcclusionResult] | None:
        """Return the task of `occlusion`; None where that is known.

        Parameters
        ----------
        finer : bool
            What was found for more packed objects does only where it would be found again.
        sure : iterable of int
            As for `occlusion`.
        """
        key = self._occlusion_key()
        known = self._known_occlusion(key, finer)
        if known is not None and not known.groups(key.packed, self._session.rules.max_group_size):
            # `filled_queue` would ask anew, and the window would wait for it.
            known = self._cache.find(key, OcclusionKey.equals)
        if not key.packed or (known is not None and known.is_swept(sure, key.packed)):
            return None
        return self._occlusion_inputs().task(key, known, sure)

    def _known_occlusion(
        self, key: OcclusionKey | None = None, finer: bool = False
    ) -> OcclusionResult | None:
        key = key or self._occlusion_key()
        found: OcclusionResult | None = self._cache.find(key, OcclusionKey.covers)
        return None if found and finer and found.may_change(key) else found

    def _occlusion_key(
        self, direction: Vector | None = None, packed: frozenset[int] | None = None
    ) -> OcclusionKey:
        session = self._session
        # Plain numbers: an array cannot be part of a key.
        leaving = triple(self.direction if direction is None else direction)
        packed = self.packed if packed is None else packed
        rules, revision = session.rules, session.label_data.revision
        return OcclusionKey(revision, leaving, rules.rule, rules.tolerance, packed)

    def _occlusion_inputs(self) -> OcclusionInputs:
        session = self._session
        lower, upper, pitch = session.bag.lower, session.bag.upper, float(session.spacing.min())
        rays, data, backend = session.ray_queries, session.label_data, session.backend
        return OcclusionInputs(rays, data, lower, upper, pitch, backend)

    def next_unpackable_task(
        self,
        n_or_ids: int | Iterable[int] = 1,
        seconds: float = float("inf"),
        clock: Callable[[], float] = perf_counter,
    ) -> Task[NextUnpackable | None] | None:
        """Return the task that finds just enough to unpack so many or these.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            As for `Session.unpack`.
        seconds : float
            After so long the task returns None.
        clock : callable
            Returns the time in seconds.

        Returns
        -------
        Task or None
            None where the whole result is known or needed.

        Raises
        ------
        ValueError
            If an ID is unknown.
        """
        session = self._session
        chosen, count = None, session.how_many_or_which(n_or_ids)
        if not isinstance(count, int):
            chosen = self.packed.intersection(count)
            count = len(chosen)
        key = self._next_key(chosen, count)
        # Moving voxels tells whether something blocks and not how much, as other rules ask.
        exact = (session.rules.rule, session.rules.tolerance) == ("exact", 0.0)
        if not exact or not session.ray_queries.can_sweep or not (key.occlusion.packed and count):
            return None
        if self._known_occlusion(key.occlusion, finer=chosen is not None) is not None:
            return None
        asked, terms = key.occlusion, session.rules.terms
        if chosen is None and session.state.queue.serves(asked.direction, asked.packed, terms):
            return None
        order, visible = self._order(key), session.label_data.visible(key.occlusion.packed)
        rays, boxes = session.ray_queries, session.label_data.boxes
        return Task(
            key, lambda _: find_next_unpackable(key, order, rays, visible, boxes, seconds, clock)
        )

    def _next_key(self, chosen: frozenset[int] | None, count: int) -> NextUnpackableKey:
        # Chosen objects are asked about one by one: together they may be larger than a group.
        most = 1 if chosen is not None else self._session.rules.max_group_size
        restored = self._session.state.queue.restored
        return NextUnpackableKey(self._occlusion_key(), chosen, count, most, restored)

    def _order(self, key: NextUnpackableKey) -> Group:
        if key.chosen is not None:
            return tuple(sorted(key.chosen))
        depths = self._session.bag.depths(np.array(key.occlusion.direction))
        return tuple(sorted(key.occlusion.packed, key=self._session.state.queue.precedence(depths)))

    def unpackable_groups(self) -> tuple[Group, ...]:
        """Return what can leave now as far as that is known, groups whole; casts no rays.

        The queue is used up before it is asked anew, so it may hold fewer.
        """
        known, queue = self._known_occlusion(), self._session.state.queue
        if known is not None:
            return tuple(known.groups(self.packed, self._session.rules.max_group_size))
        fits = queue.along(self.direction) and not queue.least_occluded
        return queue.groups if fits else ()

    def blockers(self) -> dict[int, Group]:
        """Return who stands directly in the way of each packed object, as far as known; no rays."""
        known = self._known_occlusion()
        if known is None or known.blocking is None:
            return {}
        graph = known.blocking.among(self.packed).graph
        return {int(i): tuple(sorted(map(int, graph.predecessors(i)))) for i in graph}

    def least_occluded(self) -> tuple[int, float] | None:
        """Return the object least occluded along D and its ratio, None while that is unknown."""
        known, packed = self._known_occlusion(), self.packed
        if known is None or not packed:
            return None
        least = known.least_occluded(packed)
        return least, float(known.first_hit.get(least, 0.0))

    def filled_queue(self, queue: Queue, packed: frozenset[int], agreed: bool = False) -> Queue:
        """Return a queue, filled where it was dry, made for another D, or known better by now.

        Parameters
        ----------
        queue : Queue
        packed : frozenset of int
        agreed : bool
            The queue was known to be right with more packed: those that leave only free others.
        """
        session, direction, rules = self._session, self.direction, self._session.rules
        if queue.serves(direction, packed, rules.terms):
            known = None if agreed else self._known_occlusion(self._occlusion_key(packed=packed))
            if known is None or queue.agrees(known.groups(packed, rules.max_group_size)):
                return queue
            # Those of it who can leave after all do so before others, in the order they had.
            queue = queue.put_back(queue.ids)
        if not packed:
            return queue.refilled((), direction, packed, rules=rules.terms)
        known = self.occlusion(packed=packed, finer=not self.asks_at_rest)
        groups = known.groups(packed, rules.max_group_size)
        if not groups:
            # What has left since may have blocked others, where there is no table that says so.
            known = self.occlusion(packed=packed, afresh=True)
            groups = known.groups(packed, rules.max_group_size)
        least = not groups and rules.take_least_occluded
        if least:
            groups = [(known.least_occluded(packed),)]
        depths = session.bag.depths(direction)
        return queue.refilled(groups, direction, packed, depths, least, rules.terms)

    def removal_plan(
        self, n_or_ids: int | Iterable[int], state: SessionState | None = None
    ) -> RemovalPlan:
        """Return what leaves by `Session.unpack`, which says what is raised.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            How many from the head of the queue, or which objects.
        state : SessionState, optional
            By default the state of now.
        """
        state = self._session.state if state is None else state
        which = self._session.how_many_or_which(n_or_ids)
        if isinstance(which, int):
            return self._next_removals(which, state)
        return self._chosen_removals(which, state)

    def _next_removals(self, count: int, state: SessionState) -> RemovalPlan:
        packed, queue = state.packed(self._session.label_data.known), state.queue
        found: list[Removal] = []
        left = 0
        quick = self._known_next(None, count, packed)
        if quick is not None:
            # What it holds was found for another D or another bag.
            queue = replace(queue, groups=(), least_occluded=False)
            for group in quick.groups:
                if left < count:
                    found.append(Removal(group, self.direction, len(packed), quick))
                    packed, queue, left = packed - {*group}, queue.without(group), left + len(group)
        while left < count and packed:
            filled = self.filled_queue(queue, packed, agreed=left > 0)
            source = self._known_occlusion(self._occlusion_key(packed=packed))
            if not filled.groups:
                # Fewer than were asked for, but those can leave.
                if found:
                    break
                raise NobodyFreeError(
                    f"{NOTHING_UNPACKABLE}; {self._least_sentence(packed)}. "
                    "Choose another direction, or unpack the least occluded object."
                )
            group, least = filled.groups[0], filled.least_occluded
            found.append(Removal(group, self.direction, len(packed), source, least))
            packed, queue, left = packed - {*group}, filled.without(group), left + len(group)
        return RemovalPlan(tuple(found), queue)

    def _chosen_removals(self, ids: list[int], state: SessionState) -> RemovalPlan:
        session = self._session
        packed, most = state.packed(session.label_data.known), session.rules.max_group_size
        wanted = packed.intersection(ids)
        if not wanted:
            return RemovalPlan((), state.queue)
        quick = self._known_next(wanted, len(wanted), packed)
        if quick is not None:
            return self._plan(quick.groups, self.direction, quick, state)
        known = self.occlusion(packed=packed, sure=wanted)
        if known.blocking is None:
            groups = in_turn(ids, packed, lambda left: self.occlusion(packed=left).unpackable)
            blocked = wanted.difference(*groups)
            if wanted == self._forced(packed, known):
                groups = [tuple(wanted)]
            elif blocked:
                names = listed_objects(session.names(blocked))
                raise BlockedError(f"{names} cannot leave: other objects are in the way.")
        else:
            graph = known.blocking.among(packed)
            # Interlocked objects cannot leave alone: choosing one chooses its group.
            whole = graph.interlocked(wanted)
            wanted = wanted.union(*(group for group in whole if len(group) <= most))
            blockers = graph.blockers(wanted)
            if blockers and wanted != self._forced(packed, known):
                names = listed_objects(session.names(wanted))
                first = listed_objects(session.names(blockers))
                raise BlockedError(
                    f"{names} cannot leave along this direction before {first}: unpack those "
                    "first, or choose another direction."
                )
            groups = graph.removals(wanted)
        return self._plan(groups, self.direction, known, state)

    def _forced(self, packed: frozenset[int], known: OcclusionResult) -> set[int]:
        """Return the object that may leave for want of anything unpackable."""
        rules = self._session.rules
        if not rules.take_least_occluded or known.groups(packed, rules.max_group_size):
            return set()
        return {self.occlusion(packed=packed, afresh=True).least_occluded(packed)}

    def reveal_removals(self, object_id: int, direction: Vector) -> RemovalPlan:
        """Return the smallest set of objects that frees a buried one, and it as well.

        Parameters
        ----------
        object_id : int
            A packed object.
        direction : (3,) ndarray of float64
            Along which they leave, unit vector in world.

        Raises
        ------
        NoTableError
            If it is not known what blocks what.
        """
        packed = self.packed
        known = self.occlusion(direction, sure=(object_id,))
        if known.blocking is None:
            raise NoTableError.of(len(packed))
        graph = known.blocking.among(packed)
        groups = graph.removals(graph.needed(object_id))
        return self._plan(groups, direction, known, self._session.state)

    def forced_removal(self, object_id: int) -> RemovalPlan:
        """Return that one object leaves along D, whatever it meets."""
        known, state = self._known_occlusion(), self._session.state
        return self._plan([(object_id,)], self.direction, known, state)

    def _plan(
        self,
        groups: Iterable[Group],
        direction: Vector,
        source: OcclusionResult | NextUnpackable | None,
        state: SessionState,
    ) -> RemovalPlan:
        packed, queue = len(state.packed(self._session.label_data.known)), state.queue
        removals = []
        for group in groups:
            least = queue.least_occluded and group in queue.groups
            removals.append(Removal(group, direction, packed, source, least))
            packed, queue = packed - len(group), queue.without(group)
        return RemovalPlan(tuple(removals), queue)

    def _least_sentence(self, packed: frozenset[int]) -> str:
        known = self.occlusion(packed=packed)
        least = known.least_occluded(packed)
        (name,) = self._session.names([least])
        share = share_of(known.first_hit.get(least, 0.0))
        return f"{name} is the least occluded ({share} occluded)"

    def _known_next(
        self, chosen: frozenset[int] | None, count: int, packed: frozenset[int]
    ) -> NextUnpackable | None:
        key = self._next_key(chosen, count)
        if packed != key.occlusion.packed:
            return None
        found: NextUnpackable | None = self._cache.find(key, NextUnpackableKey.covers)
        return found

    # Other directions.

    def bag_up(self) -> Vector:
        """Return up of the bag as it lies on its largest face, unit vector in world."""
        session = self._session
        up = triple(session.view_state.up)
        key = BagUpKey(session.label_data.revision, up)
        known = self._cache.find(key)
        if known is None:
            known = bag_up(oriented_box(session.bag.outer_points(), session.spacing), up)
            self._cache.keep(key, known)
        return known  # type: ignore[no-any-return]

    def survey(self) -> DirectionSurvey:
        """Return what blocks what along 26 directions; casts rays where that is not known."""
        if (task := self.survey_task()) is not None:
            self._keep(task.key, task.run(no_progress))
        return self._known_survey() or DirectionSurvey(())

    def survey_task(self) -> Task[DirectionSurvey] | None:
        """Return the task that looks along 26 directions; None where that is known."""
        key = self._survey_key()
        if not key.packed or self._known_survey() is not None:
            return None
        return Task(key, partial(find_survey, key, self._survey_counts(key)))

    def _survey_key(self) -> SurveyKey:
        session = self._session
        return SurveyKey(session.label_data.revision, session.rules.tolerance, self.packed)

    def _known_survey(self) -> DirectionSurvey | None:
        key = self._survey_key()
        found: DirectionSurvey | None = self._cache.find(key, SurveyKey.covers)
        # Where there were too many objects for tables, there may be few enough now.
        return found if found is None or found.directions else self._cache.find(key)

    def _survey_counts(self, key: SurveyKey) -> Callable[[Vector], OcclusionCounts]:
        session = self._session
        lower, upper, backend = session.bag.lower, session.bag.upper, session.backend
        # The diagonal is the longest side that a picture along any direction can have.
        coarsest = float(np.linalg.norm(upper - lower)) / MOST_SURVEY_RAYS
        pitch = max(float(session.spacing.min()), coarsest)
        visible, rays = session.label_data.visible(key.packed), session.ray_queries

        def counts(direction: Vector) -> OcclusionCounts:
            looking, size = view_along(direction, lower, upper, pitch)
            return rays.occlusion_counts(looking, visible, size, backend)

        return counts

    def best_direction(self) -> BestDirection | None:
        """Return the direction along which the most objects can leave, as far as is known.

        None also where nothing is unpackable along any of them. Ties go to the one nearest D.
        """
        known = self._known_survey()
        if known is None:
            return None
        # Not part of the key: the tables hold for groups of any size.
        most = self._session.rules.max_group_size
        return best_direction(known.directions, self.packed, most, self.direction)

    def reveal_plan(self, object_id: int) -> RevealPlan:
        """Return the least that must leave for a buried object to leave.

        Raises
        ------
        NoTableError
            If there are too many objects, or the rule has no table of blockers.
        """
        if (task := self.reveal_plan_task(object_id)) is not None:
            self.store(task, task.run(no_progress))
        known: RevealResult = self._cache.find(RevealKey(object_id, self._occlusion_key()))
        return known.plan

    def reveal_plan_task(self, object_id: int) -> Task[RevealResult] | None:
        """Return the task that finds what frees a packed object; None where that is known."""
        object_id = self._session.buried(object_id)
        key = RevealKey(object_id, self._occlusion_key())
        if self._cache.find(key) is not None:
            return None
        survey_key, known = self._survey_key(), self._known_survey()
        find = partial(find_survey, survey_key, self._survey_counts(survey_key))
        inputs = self._occlusion_inputs()

        def looked(direction: Vector) -> tuple[OcclusionKey, OcclusionResult]:
            wanted = replace(key.near, direction=triple(direction))
            before = self._known_occlusion(wanted, finer=True)
            found = inputs.task(wanted, before, (object_id,)).run(no_progress)
            return replace(wanted, packed=found.packed), found

        def run(progress: Progress) -> RevealResult:
            survey = find(progress) if known is None else known
            found = find_reveal_plan(key, (survey_key, survey), looked)
            # A known survey stands under its own key: under this one it would serve fewer.
            return found if known is None else replace(found, learnt=found.learnt[1:])

        return Task(key, run)

    # How it looks.

    def hues(self) -> dict[int, float]:
        """Return hues that keep the packed neighbours of this view apart; see `recolor`."""
        if (task := self.hues_task()) is None:
            return self._cache.find(self._hues_key())  # type: ignore[no-any-return]
        found = task.run(no_progress)
        self._cache.keep(task.key, found)
        return found

    def hues_task(self) -> Task[dict[int, float]] | None:
        """Return the task that chooses hues for this view; None where they are known."""
        key, session = self._hues_key(), self._session
        if self._cache.find(key) is not None:
            return None
        view, visible = session.view_state, session.label_data.visible(key.visibility.packed)
        rays, backend, cache = session.ray_queries, session.backend, self._cache
        hues = session.state.hues

        def run(_: Progress) -> dict[int, float]:
            # Another margin, or a hue locked, needs no new rays.
            graph: nx.Graph | None = cache.find(key.visibility)
            if graph is None:
                graph = colors.find_interference(
                    key.visibility, rays, visible, view.clipping, backend
                )
                cache.keep(key.visibility, graph)
            return colors.chosen_hues(graph, key, hues)

        return Task(key, run)

    def _hues_key(self) -> HuesKey:
        session = self._session
        state, view, data = session.state, session.view_state, session.label_data
        # What flies has left the bag's picture, and keeps its hue.
        shown = frozenset(ids_in(self.states(), ObjectState.PACKED))
        visibility = VisibilityKey(
            data.revision, view.camera, view.canvas_size, shown, view.clipping.tobytes()
        )
        # Before hues were chosen for any view there is nothing worth keeping.
        previous = Identity(state.hues) if view.recolored else None
        # What is locked or has its own colour stays as it is, and its neighbours give way to it.
        fixed = {i: hue for i, hue in state.hues.items() if i in view.locked_hues}
        fixed |= {i: nearest_hue(c, view.tint_mode) for i, c in state.colors.items()}
        held = frozenset(fixed.items())
        seen = {i: at for i, at in state.placements.items() if i not in state.hidden}
        beside = colors.pairs_beside(seen, self.slots())
        standing = Identity(state.hues) if beside else None
        return HuesKey(visibility, previous, view.hue_margin, held, beside, standing)

    def states(self) -> dict[int, ObjectState]:
        """Return where every object is, by ID; treat as read-only."""
        session = self._session
        flights, state = session.flights, session.state
        key = StatesKey(state, flights.version, session.label_data.revision)
        known: dict[int, ObjectState] | None = self._cache.find(key)
        if known is None:
            known = {i: state.state(i) for i in session.label_data.ids}
            # The state is already that after landing.
            for i, flight in flights.items():
                known[i] = ObjectState.FLYING_BACK if flight.back else ObjectState.FLYING_OUT
            self._cache.keep(key, known)
        return known

    def slots(self, placements: Mapping[int, Placement] | None = None) -> Slots:
        """Return where unpacked objects wait: more slots, in steps, as more of them are out.

        Parameters
        ----------
        placements : mapping of int to Placement, optional
            Of what is out; by default as it is now.
        """
        session, view = self._session, self._session.view_state
        radius = session.bag.radius_in(view.camera.stretch)
        out = session.state.placements if placements is None else placements
        taken = 1 + max((one.slot for one in out.values()), default=-1)
        # Of all labels so far: slots stay where they are when two objects are merged.
        count = room_for(taken, session.label_data.most_objects)
        key = SlotsKey(count, radius, view.canvas_size, view.camera.fov)
        known = self._cache.find(key)
        if known is None:
            known = arrange(*key)
            self._cache.keep(key, known)
        return known  # type: ignore[no-any-return]

    # Labels of other steps.

    def labels_at(self, edit: Edit | None) -> LabelData:
        """Return the labels after an edit."""
        data = self._session.label_data
        # Kept any longer it would keep a whole volume alive after the next edit.
        known: LabelData | None = self._cache.take(LabelsKey(data.revision, edit, data.rating))
        return data.at(edit) if known is None else known.seen_from(data)

    def labels_task(self, way: Literal["undo", "redo"]) -> Task[LabelData] | None:
        """Return the task that works out the labels after undo or redo.

        None where they are known at once: most steps leave the labels alone, and those before
        the last edit are kept. Otherwise it takes a second for a large volume.
        """
        session, source = self._session, self._session.label_data
        edit = session.history.edit_after(way, session.state.labels_edit)
        key = LabelsKey(source.revision, edit, source.rating)
        # Nothing to prepare: no volume would be copied.
        if source.knows(edit) or self._cache.find(key) is not None:
            return None
        return Task(key, lambda _: source.at(edit))
