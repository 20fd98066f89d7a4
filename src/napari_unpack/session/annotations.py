"""What a person says of objects: colours of their own, notes and flags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from napari_unpack.appearance.tints import Rgba
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session import commands
from napari_unpack.session.document import Document
from napari_unpack.session.labels import one_line
from napari_unpack.session.state import FLAGS, Flag, SessionState
from napari_unpack.session.validation import checked_kind, checked_style

T = TypeVar("T")


class Annotations:
    """Own colours, notes and flags of a session's objects; every change is a step of undo.

    Parameters
    ----------
    document : Document
        Of the session.
    """

    def __init__(self, document: Document) -> None:
        self._doc = document

    @property
    def colors(self) -> dict[int, Rgba]:
        """Straight RGBA by ID, where a person gave one; a copy."""
        return dict(self._doc.state.colors)

    @property
    def notes(self) -> dict[int, str]:
        """What is noted of objects, by ID; a copy."""
        return dict(self._doc.state.notes)

    @property
    def flags(self) -> dict[int, Flag]:
        """The objects that are "suspicious" or "cleared", by ID; a copy."""
        return dict(self._doc.state.flags)

    def set_color(
        self, ids: int | Iterable[int], color: Sequence[float] | None, merge: bool = False
    ) -> None:
        """Give objects a colour and an opacity of their own, in every view.

        Parameters
        ----------
        ids : int or iterable of int
        color : (3,) or (4,) sequence of float, optional
            Straight RGB or RGBA from 0 to 1, the opacity as people see it. None takes the hue of
            the view again.
        merge : bool
            Make one step of undo of successive calls, as while one chooses.

        Raises
        ------
        ValueError
            If it is no colour.
        """
        wanted = None if color is None else _checked_color(color)
        after = _changed(self._doc.state.colors, self._doc.checked(ids), wanted)
        if after != self._doc.state.colors:
            self._doc.commit("colour", replace(self._doc.state, colors=after), merge)

    def name_and_color(
        self, names: Mapping[int, str], colors: Mapping[int, Sequence[float]]
    ) -> None:
        """Give objects names and colours, as another program has them: one step of undo.

        Parameters
        ----------
        names : mapping of int to str
            By ID; a blank one leaves an object its name.
        colors : mapping of int to (3,) or (4,) sequence of float
            By ID, as for `set_color`.

        Raises
        ------
        ValueError
            If there is no such object, or something is no colour.
        TypeError
            If a name is no text.
        """
        for name in names.values():
            checked_kind(name, str, "name")
        state, checked = self._doc.state, {i: _checked_color(c) for i, c in colors.items()}
        self._doc.checked([*names, *checked])
        called = self._doc.objects["name"]
        wanted = {i: one_line(name) for i, name in names.items() if name.strip()}
        told = {i: name for i, name in wanted.items() if name != called[i]}
        new = replace(state, names={**state.names, **told}, colors={**state.colors, **checked})
        if (new.names, new.colors) != (state.names, state.colors):
            self._doc.commit("names and colours", new)

    def take_names(self, names: Mapping[int, str]) -> None:
        """Call objects as the bag around them does, in place of names given here.

        Parameters
        ----------
        names : mapping of int to str
            By ID.

        Notes
        -----
        They count as names the objects came with: no step of undo, and none was given here.
        """

        def unnamed(state: SessionState) -> SessionState:
            kept = {i: name for i, name in state.names.items() if i not in names}
            return replace(state, names=kept)

        self._doc.label_data = self._doc.label_data.renamed(names)
        # Or redo would give one of before, which the bag would then take.
        self._doc.history.every(unnamed)
        self._doc.enter(unnamed(self._doc.state))

    def set_style(self, object_id: int, style: ObjectStyle | None) -> None:
        """Give an object an opacity curve or a cut of its own; see `Session.set_style`.

        Parameters
        ----------
        object_id : int
        style : ObjectStyle or None
        """
        document, state = self._doc, self._doc.state
        new = commands.set_style(state, document.one(object_id), checked_style(style))
        before, after = (one.styles.get(object_id, ObjectStyle()) for one in (state, new))
        same_curve = before.transfer_function == after.transfer_function
        # While one inspects, a cut is a way of looking: it ends with that, and is no step.
        if object_id == state.inspected and same_curve:
            document.enter(new)
        else:
            # The ID is part of the verb, so that steps of two objects do not become one.
            document.commit(f"style {object_id}", new, merge=True)

    def set_note(self, object_id: int, text: str) -> None:
        """Write a note on an object; a blank one takes it away.

        Parameters
        ----------
        object_id : int
        text : str

        Raises
        ------
        TypeError
            If it is no text.
        """
        checked_kind(text, str, "text")
        after = _changed(self._doc.state.notes, [self._doc.one(object_id)], text.strip() or None)
        if after != self._doc.state.notes:
            self._doc.commit("note", replace(self._doc.state, notes=after))

    def set_flag(self, ids: int | Iterable[int], flag: Flag | None) -> None:
        """Flag objects as suspicious or cleared, or as not decided yet.

        Parameters
        ----------
        ids : int or iterable of int
        flag : {"suspicious", "cleared"}, optional
            None takes the flag away.

        Raises
        ------
        ValueError
            If there is no such flag.
        """
        if flag is not None and flag not in FLAGS:
            raise ValueError(f"flag must be one of {', '.join(FLAGS)} or None, got {flag!r}")
        after = _changed(self._doc.state.flags, self._doc.checked(ids), flag)
        if after != self._doc.state.flags:
            self._doc.commit("flag", replace(self._doc.state, flags=after))


def _changed(before: Mapping[int, T], ids: Iterable[int], value: T | None) -> dict[int, T]:
    """Return a mapping with a value for some IDs, or without them for None."""
    chosen = set(ids)
    kept = {i: one for i, one in before.items() if i not in chosen}
    return kept if value is None else kept | dict.fromkeys(sorted(chosen), value)


def _checked_color(color: Sequence[float]) -> Rgba:
    try:
        values = [float(v) for v in color]
    except (TypeError, ValueError):
        values = []
    # Not-a-number is between no two numbers.
    if len(values) not in (3, 4) or not all(0.0 <= v <= 1.0 for v in values):
        raise ValueError(f"color must be three or four numbers from 0 to 1, got {color!r}")
    red, green, blue, opacity = (*values, 1.0)[:4]
    return red, green, blue, opacity
