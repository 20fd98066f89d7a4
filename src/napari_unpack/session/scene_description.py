"""What rendering needs of a session, described as a frozen `Scene`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from napari_unpack.appearance import Decorations
from napari_unpack.rendering.rulers import Ruler
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import RenderCache
from napari_unpack.session.labels import LabelData
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.session.state import SessionState

if TYPE_CHECKING:
    from napari_unpack.session.session import Session


class SceneDescription:
    """Describes one session again and again; the same scene as long as nothing has changed."""

    def __init__(self) -> None:
        self._cache = RenderCache()
        self._known: tuple[tuple[Any, ...], Scene] | None = None
        self._densities: tuple[Any, dict[int, float]] | None = None

    def of(self, session: Session) -> Scene:
        """Return the scene of a session as it is now."""
        parts = _parts(session)
        known = self._known
        # Two scenes that show the same would each make their tables of tints.
        if known is None or not _same(known[0], parts):
            known = self._known = parts, self._described(session)
        return known[1]

    def _described(self, session: Session) -> Scene:
        state, view, data, states = (
            session.state, session.view_state, session.label_data, session.states,
        )  # fmt: skip
        return Scene(
            volume=session.volume,
            label_data=data,
            spacing=session.spacing,
            transfer_function=state.transfer_function,
            packed=frozenset(ids_in(states, ObjectState.PACKED)),
            inspected=tuple(ids_in(states, ObjectState.INSPECTED)),
            flights=dict(session.flights),
            poses=session.poses,
            hues=state.hues,
            colors=state.colors,
            tint_mode=view.tint_mode,
            show_unlabelled=view.show_unlabelled,
            styles=state.styles,
            mean_densities=self._mean_densities(data),
            clipping=view.clipping,
            decorations=view.decorations,
            rulers=_rulers(state, view.decorations),
            largest_id=data.largest_id,
            cache=self._cache,
        )

    def _mean_densities(self, data: LabelData) -> dict[int, float]:
        known = self._densities
        if known is None or known[0] is not data.facts:
            known = self._densities = data.facts, data.facts["mean_density"].to_dict()
        return known[1]


def _rulers(state: SessionState, around: Decorations) -> tuple[Ruler, ...]:
    if not around.measurements:
        return ()
    return tuple(Ruler(m.objects, m.ends, m.numbers_in(around.unit)) for m in state.measurements)


def _parts(session: Session) -> tuple[Any, ...]:
    """Return what a scene is made of; each part is exchanged, never changed."""
    view = session.view_state
    # Not the whole of the view: every movement of the camera makes another one.
    return (
        session.label_data,
        session.state,
        session.slots,
        view.clipping,
        view.decorations,
        view.camera.stretch.tobytes(),
        view.tint_mode,
        view.show_unlabelled,
        *session.flights.values(),
    )


def _same(before: tuple[Any, ...], now: tuple[Any, ...]) -> bool:
    if len(before) != len(now):
        return False
    pairs = zip(before, now, strict=True)
    return all(a is b or (isinstance(a, bytes | str) and a == b) for a, b in pairs)
