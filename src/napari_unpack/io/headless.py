"""A session without a window: opened from a scan, framed, and unpacked step by step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from napari_unpack.geometry.axes import triple
from napari_unpack.geometry.view import Camera, View
from napari_unpack.io.scan import Scan
from napari_unpack.tasks import Progress

if TYPE_CHECKING:
    from napari_unpack.appearance import Decorations
    from napari_unpack.session import Session
    from napari_unpack.session.labels import LabelData
    from napari_unpack.session.state import SessionState, UnpackingRules, ViewState


def open_scan(
    scan: Scan,
    view: Sequence[float],
    direction: str | Sequence[float] | None = None,
    progress: Progress | None = None,
    backend: str = "auto",
    **settings: Any,
) -> Session:
    """Open a session on a scan, coloured for a view; segment it where it has no labels.

    Parameters
    ----------
    scan : Scan
        The bag.
    view : (3,) sequence of float
        Direction of looking, z y x.
    direction : str or (3,) sequence of float, optional
        Where objects leave, see `Session.direction`.
    progress : callable, optional
        Takes (fraction, text); raising in it cancels.
    backend : {"auto", "cpu", "gl"}
    **settings
        Of `segment`.

    Raises
    ------
    ValueError
        If the scan cannot be segmented, or an argument is not as above.
    """
    # Imported late: they load numba and the network, which labels in the file make needless.
    from napari_unpack.segmentation import segment
    from napari_unpack.session import Session
    from napari_unpack.unpacking.direction import checked_direction

    # Before the long work: what cannot be is told at once.
    looking, leaving = View(triple(view)), checked_direction(direction)
    labels, objects, evidence = scan.labels, named_objects(scan.names), None
    if labels is None:
        found = segment(scan.volume, scan.spacing, progress=progress, **settings)
        labels, objects, evidence = found.labels, found.objects, found.evidence
    session = Session(scan.volume, labels, scan.spacing, objects)
    session.review.evidence = evidence
    # Before the view: colours are chosen from rays, which the backend casts.
    session.backend, session.scanner_from_scan = backend, scan.scanner_from_scan
    session.assumed = scan.assumed
    session.view = looking
    if leaving is not None:
        session.direction = leaving
    # Once the view is set: hues follow which objects overlap in it.
    session.recolor()
    return session


def named_objects(names: Mapping[int, str] | None) -> Any:
    """Return the table a session takes its names from; None where there are no names."""
    if not names:
        return None
    import pandas as pd

    return pd.DataFrame({"name": list(names.values())}, index=pd.Index(list(names), name="id"))


def frame_bag(session: Session, size: tuple[int, int]) -> Camera:
    """Give a session the size of an image and the camera, returned, that shows bag and all slots.

    Parameters
    ----------
    session : Session
        Its direction of looking is kept.
    size : (int, int)
        Height and width, pixels.
    """
    # The size first: slots, and so the overview, follow the shape of the image.
    session.canvas_size = size
    camera = session.overview()
    session.look(camera)
    return camera


def packed_copy(session: Session) -> Session:
    """Return another session on the same bag with everything packed and nothing inspected.

    `Session.go_to` repeats there what is out step by step.

    Parameters
    ----------
    session : Session
        Its arrays are shared; view, colours, direction, hidden objects and rules are taken over.
    """
    from napari_unpack.session.commands import go_to
    from napari_unpack.session.object_state import ObjectState, ids_in
    from napari_unpack.session.state import SessionState, ViewState

    now, view = session.state, session.view_state
    # What was hidden stays out of the movie; the rest goes back into the bag.
    hidden = frozenset(ids_in(session.states, ObjectState.HIDDEN))
    steps = (
        {i: p.without(hidden) for i, p in gone.items() if i not in hidden}
        for gone in go_to(now, 0).undone
    )
    return _of_parts(
        session,
        # Names of now; no trace of edits, as the copy has nothing to undo.
        replace(session.label_data, facts=session.objects, edit=None, previous=None),
        SessionState(
            now.transfer_function,
            now.hues,
            hidden=hidden,
            direction=now.direction,
            styles=now.styles,
            colors=now.colors,
            measurements=now.measurements,
            undone=tuple(filter(None, steps)),
        ),
        ViewState(
            view.view,
            view.camera,
            clipping=view.clipping,
            decorations=view.decorations,
            tint_mode=view.tint_mode,
            show_unlabelled=view.show_unlabelled,
            up=view.up,
            recolored=True,
        ),
        # A movie shall end with the bag empty: interlocked objects may not stop it.
        replace(session.rules, take_least_occluded=True),
    )


def snapshot(session: Session) -> Session:
    """Return a session as it is now, with nothing to undo.

    For work on another thread, which must not see half of what a person changes meanwhile.

    Parameters
    ----------
    session : Session
        Its arrays are shared.
    """
    now, view = session.state, session.view_state
    other = _of_parts(session, session.label_data, now, view, session.rules)
    other.seconds, other.review.evidence = session.seconds, session.review.evidence
    other.log.extend(session.log)
    for object_id, bag in session.opened_bags.worked_in(session).items():
        other.opened_bags.restore(other, object_id, snapshot(bag))
    return other


def _of_parts(
    session: Session,
    data: LabelData,
    state: SessionState,
    view: ViewState,
    rules: UnpackingRules,
) -> Session:
    """Return a session of the same scan, drawn and measured like it."""
    from napari_unpack.session import Session

    # Arrays and ray queries are shared: a copy costs no memory, and its rays are ready.
    other = Session.of_parts(
        session.volume, session.spacing, data, state, view, rules, session.ray_queries
    )
    other.backend, other.scanner_from_scan = session.backend, session.scanner_from_scan
    other.assumed, other.first_voxel_mm = session.assumed, session.first_voxel_mm
    return other


def decorated(
    session: Session, background: object, decorations: Iterable[str] | None
) -> Decorations:
    """Return a session's decorations, with another background or others if asked.

    Parameters
    ----------
    session : Session
        Whose decorations are the defaults.
    background : object
        As `Background.of` takes it; None for the session's.
    decorations : iterable of str, optional
        Out of "box" and "scale".

    Raises
    ------
    ValueError
        If there is no such background or decoration.
    """
    from napari_unpack.appearance import Decorations

    around = session.decorations
    shown = [kind for kind in ("box", "scale") if getattr(around, kind)]
    made = Decorations.of(
        around.background if background is None else background,
        shown if decorations is None else decorations,
    )
    return replace(made, unit=around.unit, measurements=around.measurements)


def packed_count(session: Session) -> int:
    """Return how many objects are in the bag and in sight."""
    from napari_unpack.session import ObjectState

    return sum(state is ObjectState.PACKED for state in session.states.values())


def unpack_in_order(session: Session, count: int | None = None) -> Iterator[tuple[int, ...]]:
    """Unpack step by step, each object or group that can leave next.

    Parameters
    ----------
    session : Session
        Changed step by step.
    count : int, optional
        How many objects at least; by default all. Where nothing is unpackable the least
        occluded object leaves, so that all come out.

    Yields
    ------
    tuple of int
        The objects that left in this step.
    """
    gone = 0
    while packed_count(session) and (count is None or gone < count):
        left = tuple(session.unpack(1))
        # Nothing more can leave: without this the loop would never end.
        if not left:
            return
        gone += len(left)
        yield left
