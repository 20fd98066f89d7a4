"""A session as plain data, and back: all of it but volume, labels and the steps of undo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance.tints import Mode
from napari_unpack.session.fields import Fields
from napari_unpack.session.log import LogEntry
from napari_unpack.session.objects_record import objects_record, session_of
from napari_unpack.session.session import Session
from napari_unpack.session.situation_record import situation_from, situation_record
from napari_unpack.session.surroundings_record import surroundings_from, surroundings_record
from napari_unpack.session.view_record import camera_from, camera_record, view_from, view_record
from napari_unpack.unpacking.occlusion import Rule


def record_of(session: Session) -> dict[str, Any]:
    """Return a session as plain data.

    Parameters
    ----------
    session : Session
        What is in the air counts as landed.

    Returns
    -------
    dict
        Of what JSON knows, floats exact; NaN does not occur.
    """
    return {
        "spacing": session.spacing.tolist(),
        "situation": situation_record(session),
        "rules": {
            "rule": session.rule,
            "tolerance": session.tolerance,
            "most_in_group": session.most_in_group,
            "take_least_occluded": session.take_least_occluded,
        },
        "look": {
            "tint_mode": session.tint_mode,
            "show_unlabelled": session.show_unlabelled,
            "locked_hues": sorted(session.locked_hues),
            "hue_margin": session.hue_margin,
            "colored": session._colored,
            "clipping": session.clipping.tolist(),
            "surroundings": surroundings_record(session.surroundings),
        },
        "camera": camera_record(session.camera),
        "view": view_record(session.view),
        "canvas_size": list(session.canvas_size),
        "seconds": session.seconds,
        "away_from_table": session.away_from_table.tolist(),
        "selected": sorted(session.selected),
        "log": [
            {
                "event": entry.event,
                "ids": list(entry.ids),
                "packed": entry.packed,
                "ratio": entry.ratio,
                "seconds": entry.seconds,
            }
            for entry in session.log
        ],
        "objects": objects_record(session),
    }


def session_from(record: Mapping[str, Any], volume: ArrayLike, labels: ArrayLike) -> Session:
    """Make the session a record was made of.

    Parameters
    ----------
    record : mapping
        From `record_of`.
    volume : (Z, Y, X) array_like
        Density.
    labels : (Z, Y, X) array_like of int
        Object IDs, with the IDs they were given with.

    Returns
    -------
    Session
        In exactly that state, with nothing to undo.

    Raises
    ------
    ValueError
        If the record says something that cannot be, naming the field; or as for `Session`.
    """
    fields = Fields(record, "session")
    spacing = fields.array("spacing", (3,))
    session = session_of(fields.part("objects"), spacing, volume, labels)
    known = frozenset(session.ids)
    rules, look = fields.part("rules"), fields.part("look")
    session.rule = rules.text("rule", get_args(Rule))  # type: ignore[assignment]
    session.tolerance = rules.number("tolerance")
    session.most_in_group = rules.integer("most_in_group", 1)
    session.take_least_occluded = rules.flag("take_least_occluded")
    session.tint_mode = look.text("tint_mode", get_args(Mode))  # type: ignore[assignment]
    session.show_unlabelled = look.flag("show_unlabelled")
    session.locked_hues = frozenset(look.ids("locked_hues", known))
    session.hue_margin = look.number("hue_margin")
    session._colored = look.flag("colored")
    session.clipping = look.array("clipping", (len(look.items("clipping")), 2, 3))
    if look.has("surroundings"):
        session.surroundings = surroundings_from(look.part("surroundings"))
    height, width = (int(n) for n in fields.array("canvas_size", (2,)))
    session.canvas_size = height, width
    session.seconds = fields.positive("seconds")
    session.view = view_from(fields.part("view"))
    session._camera = camera_from(fields.part("camera"))
    if fields.has("away_from_table"):
        session.away_from_table = fields.array("away_from_table", (3,))
    session.log.extend(_log(fields))
    session._situation = situation_from(fields.part("situation"), session, known)
    session._tell_states(known)
    session.select(fields.ids("selected", known))
    return session


def given_labels(session: Session) -> NDArray[Any]:
    """Return the (Z, Y, X) labels with the IDs they came with."""
    given = session._given_ids
    return np.asarray(session.labels if given is None else given[session.labels])


def _log(fields: Fields) -> list[LogEntry]:
    # Who left may have been deleted or merged since.
    return [
        LogEntry(
            entry.text("event"),
            entry.ids("ids"),
            entry.integer("packed"),
            entry.number("ratio"),
            entry.number("seconds"),
        )
        for entry in fields.parts("log")
    ]
