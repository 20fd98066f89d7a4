"""A stage steered: its camera set, its unpacking run to any step, its pictures waited for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from time import monotonic, sleep
from typing import Any, Literal

import numpy as np
from qtpy.QtCore import QCoreApplication, QEventLoop

from napari_unpack.geometry.view import GRAVITY_UP, Camera
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.placement import napari_from_world, units_of
from napari_unpack.layers.view_camera import ALIKE, napari_view, parts_of
from napari_unpack.raycasting import WAY

GLIMPSE_SECONDS = 0.04
"""How long objects are moved one by one before the question goes to a worker."""

IDLE_SECONDS = 0.002

LONGER_SECONDS = 1.0
"""How long a worker goes on so before it asks about everybody."""


def point_camera(viewer: Any, layer: Any, camera: Camera) -> None:
    """Have a viewer look as a camera does.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : napari layer
        One of ours, which knows how world mm lie in napari's world.
    camera : Camera
        Of the session.
    """
    height = viewer.canvas.size[0]
    world = napari_from_world(layer, units_of(viewer))
    center, zoom, direction, up = napari_view(camera, world, height)
    theirs = viewer.scene.camera
    theirs.perspective = camera.fov
    theirs.center = tuple(center)
    theirs.set_view_direction(tuple(direction), tuple(up))
    theirs.zoom = zoom


def look_through(viewer: Any, session: Any, layer: Any) -> None:
    """Have a session look at its bag as a layer places it, and know what is up there.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
        It keeps its direction of looking.
    layer : napari layer
        One of ours.
    """
    world = napari_from_world(layer, units_of(viewer))
    # Level things have normals, which an affine maps the other way than points.
    session.away_from_table = world[:3, :3].T @ GRAVITY_UP
    stretch = parts_of(world)[2]
    seen = session.camera
    if not np.allclose(stretch, seen.stretch, rtol=0, atol=ALIKE):
        session.look(
            Camera.looking(seen.direction, seen.up, seen.center, seen.height, seen.fov, stretch)
        )


def wait_until(settled: Callable[[], bool], seconds: float) -> bool:
    """Handle events until something holds, at most so long; return whether it does."""
    limit = monotonic() + seconds
    flags = QEventLoop.ProcessEventsFlag.AllEvents
    while monotonic() < limit:
        QCoreApplication.processEvents(flags, 20)
        if settled():
            # One draw more may still change the frame.
            QCoreApplication.processEvents(flags, 20)
            if settled():
                return True
        # Workers need the interpreter, which an idle loop would hardly let go of.
        sleep(IDLE_SECONDS)
    return False


def know_who_leaves(
    session: Any,
    jobs: Jobs,
    n_or_ids: int | Iterable[int] | None,
    looking: Callable[[bool], None],
) -> None:
    """Find out what it takes to unpack so many or these.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    n_or_ids : int or iterable of int or None
        See `Session.unpack`; None asks for the whole answer.
    looking : callable
        Told True when it takes longer than a moment, and False after.

    Notes
    -----
    At once where moving a few objects tells; the whole answer is then asked for when everything
    is at rest. Else that answer is waited for, drawing meanwhile.
    """
    question = None if n_or_ids is None else session.glimpse_question(n_or_ids)
    glimpse = None
    if question is not None:
        with WAY.taken():
            glimpse = question.answer(GLIMPSE_SECONDS)
    if glimpse is not None and session.accept_glimpse(glimpse):
        return
    if session.occlusion_question() is None:
        return
    looking(True)
    try:
        if question is not None:
            glimpse = jobs.do("queue", "glimpse", partial(question.answer, LONGER_SECONDS))
            if glimpse is not None and session.accept_glimpse(glimpse):
                return
        # What was asked at rest may be the same.
        jobs.wait("queue")
        whole = session.occlusion_question()
        answer = None if whole is None else jobs.do("queue", "queue", whole.answer)
        if answer is not None:
            session.accept_answer(answer)
    finally:
        looking(False)


def travel(session: Any, jobs: Jobs, way: Literal["undo", "redo"]) -> Any:
    """Go a step back or forth; labels that take a while are worked out in a worker, drawing on.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    way : {"undo", "redo"}

    Returns
    -------
    str or None
        See `Session.undo`.
    """
    question = session.labels_question(way)
    if question is not None:
        session.accept_labels(jobs.do("queue", "labels", question.answer))
    return getattr(session, way)()


def run_to(
    session: Any, jobs: Jobs, step: int, flying: bool, looking: Callable[[bool], None]
) -> int:
    """Run the unpacking to a step; see `Session.go_to`.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    step : int
    flying : bool
        Whether objects fly there; else they are there at once.
    looking : callable
        See `know_who_leaves`.

    Returns
    -------
    int
        The step reached.
    """
    if step > len(session.steps):
        one_more = step == session.step + 1
        know_who_leaves(session, jobs, 1 if one_more else None, looking)
    animated = session.animated
    session.animated = animated and flying
    try:
        return int(session.go_to(step))
    finally:
        session.animated = animated
