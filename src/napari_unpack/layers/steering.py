"""A stage steered: its camera set, its unpacking run to any step, its pictures waited for."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any

from qtpy.QtCore import QCoreApplication, QEventLoop

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.placement import napari_from_world
from napari_unpack.layers.view_camera import napari_view


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
    center, zoom, direction, up = napari_view(camera, napari_from_world(layer), height)
    theirs = viewer.scene.camera
    theirs.perspective = camera.fov
    theirs.center = tuple(center)
    theirs.set_view_direction(tuple(direction), tuple(up))
    theirs.zoom = zoom


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
    return False


def know_who_is_free(session: Any, jobs: Jobs) -> None:
    """Have the session's question answered in a worker, drawing meanwhile."""
    question = session.occlusion_question()
    if question is not None:
        answer = jobs.do("fine", "who is free", question.answer)
        if answer is not None:
            session.accept_answer(answer)


def run_to(session: Any, jobs: Jobs, step: int, flying: bool) -> int:
    """Run the unpacking to a step; see `Session.go_to`.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "fine".
    step : int
    flying : bool
        Whether objects fly there; else they are there at once.

    Returns
    -------
    int
        The step reached.
    """
    if step > len(session.steps):
        know_who_is_free(session, jobs)
    animated = session.animated
    session.animated = animated and flying
    try:
        return int(session.go_to(step))
    finally:
        session.animated = animated
