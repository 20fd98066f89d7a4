"""What a command must know before it can be carried out: worked out while the canvas goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

from napari_unpack.rendering.cpu import INTERACTIVE_PRIORITY
from napari_unpack.tasks import Progress, Task, no_progress
from napari_unpack.viewer.background_queries import OCCLUSION
from napari_unpack.viewer.scheduler import Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session

# How long objects are moved one by one before a worker goes on: not felt in a click.
AT_ONCE_SECONDS = 0.04

# How long a worker goes on so before it asks about all objects, which takes about as long.
LONGER_SECONDS = 1.0


def find_unpackable(
    session: Session,
    scheduler: Scheduler,
    n_or_ids: int | Iterable[int] | None,
    searching: Callable[[bool], None],
) -> bool:
    """Find out what it takes to unpack so many or these.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    n_or_ids : int or iterable of int or None
        See `Session.unpack`; None asks about all objects.
    searching : callable
        Given True when it takes longer than a moment, and False after.

    Returns
    -------
    bool
        False where the scheduler was closed in the wait: nothing is to be unpacked any more.

    Notes
    -----
    At once where moving a few objects tells; the question about all of them is then asked when
    nothing moves. Else that answer is waited for, drawing meanwhile.
    """
    was_open = not scheduler.closed
    _find(session, scheduler, n_or_ids, searching)
    return not (was_open and scheduler.closed)


def _find(
    session: Session,
    scheduler: Scheduler,
    n_or_ids: int | Iterable[int] | None,
    searching: Callable[[bool], None],
) -> None:
    queries = session.queries
    quick = None
    if n_or_ids is not None:
        quick = queries.next_unpackable_task(n_or_ids, AT_ONCE_SECONDS)
    if quick is not None:
        with INTERACTIVE_PRIORITY.taken():
            found = quick.run(no_progress)
        if queries.store(quick, found):
            return
    # The queue is conservative until nothing moves; one who chooses is told what holds now.
    chosen: frozenset[int] = frozenset()
    if n_or_ids is not None and not isinstance(n_or_ids, int):
        chosen = queries.packed.intersection(n_or_ids)
    if queries.occlusion_task(finer=bool(chosen), sure=chosen) is None:
        return
    searching(True)
    try:
        if quick is not None and n_or_ids is not None:
            longer = queries.next_unpackable_task(n_or_ids, LONGER_SECONDS)
            if longer is not None and queries.store(
                longer, scheduler.run_modal(longer, Worker.QUERY, "next unpackable")
            ):
                return
        # What was asked when nothing moved may be the same.
        scheduler.wait(OCCLUSION)
        occlusion = queries.occlusion_task(finer=bool(chosen), sure=chosen)
        if occlusion is not None:
            queries.store(occlusion, scheduler.run_modal(occlusion, Worker.QUERY, OCCLUSION))
    finally:
        searching(False)


def boxes_task(session: Session, ids: Iterable[int]) -> Task[None] | None:
    """Return the task that finds how objects are held up: their tightest boxes; None if known.

    Parameters
    ----------
    session : Session
    ids : iterable of int
        Of packed objects.
    """
    bag, stretch = session.bag, session.camera.stretch
    wanted = bag.unmeasured(ids, stretch)

    def run(progress: Progress) -> None:
        for k, object_id in enumerate(wanted):
            progress(k / len(wanted), "")
            bag.oriented(object_id, stretch)

    return Task(("boxes", *wanted), run) if wanted else None


def measure_next(session: Session, scheduler: Scheduler, n_or_ids: int | Iterable[int]) -> bool:
    """Have a worker measure what is to leave, of which the window would feel every object.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    n_or_ids : int or iterable of int
        See `Session.unpack`.

    Returns
    -------
    bool
        As `find_unpackable`.
    """
    was_open = not scheduler.closed
    # What cannot leave is told by the command itself.
    with suppress(ValueError):
        task = boxes_task(session, session.queries.removal_plan(n_or_ids).ids)
        if task is not None:
            # The worker of flights: a query under way may take seconds.
            scheduler.run_modal(task, Worker.MOTION)
    return not (was_open and scheduler.closed)


def travel(session: Session, scheduler: Scheduler, way: Literal["undo", "redo"]) -> str | None:
    """Go a step back or forth; labels that take a while are worked out first, drawing on.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    way : {"undo", "redo"}

    Returns
    -------
    str or None
        See `Session.undo`.
    """
    task = session.queries.labels_task(way)
    if task is not None:
        session.queries.store(task, scheduler.run_modal(task, Worker.QUERY, "labels"))
    return session.undo() if way == "undo" else session.redo()


def choose_hues(session: Session, scheduler: Scheduler) -> None:
    """Choose new hues for this view; rays are cast and hues are sought while drawing.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    """
    task = session.queries.hues_task()
    if task is None:
        session.recolor()
        return
    # The worker of flights: a query under way may take seconds.
    found = scheduler.run_modal(task, Worker.MOTION)
    if found is not None:
        session.queries.store(task, found)
        # Not `Session.recolor`: what glides may have changed the view, for which it would ask anew.
        # A repair that ended in the wait may have taken objects away.
        session.apply_hues({i: h for i, h in found.items() if i in session.label_data.known})


def run_to(
    session: Session,
    scheduler: Scheduler,
    step: int,
    flying: bool,
    searching: Callable[[bool], None],
) -> int:
    """Run the unpacking to a step; see `Session.go_to`.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    step : int
    flying : bool
        Whether objects fly there; else they are there at once.
    searching : callable
        See `find_unpackable`.

    Returns
    -------
    int
        The step reached.
    """
    if step > len(session.steps):
        # One step ahead may be found by moving a few objects; more need the whole answer.
        one_more = step == session.step + 1
        if not find_unpackable(session, scheduler, 1 if one_more else None, searching):
            return session.step
        if not measure_next(session, scheduler, step - session.step):
            return session.step
    animated = session.animated
    # Not `Session.animated`, which lands what is in the air already.
    session.flights.set_pace(animated=animated and flying)
    try:
        return session.go_to(step)
    finally:
        session.flights.set_pace(animated=animated)
