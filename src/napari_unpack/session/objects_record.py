"""The table of objects as plain data, and a session with everything packed made of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.compaction import compact_labels
from napari_unpack.session.fields import Fields
from napari_unpack.session.session import Session

_NUMBERS = frozenset({"voxels", "volume_mm3", "mean_density", "confidence", "z", "y", "x"})


def objects_record(session: Session) -> dict[str, Any]:
    """Return the facts of a session's objects, and how they are numbered, as plain data."""
    facts = session._facts
    return {
        "ids": [int(i) for i in facts.index],
        "given_ids": None if session._given_ids is None else session._given_ids.tolist(),
        "slots": session._most,
        "largest_id": session._top,
        "columns": {str(name): [_plain(v) for v in facts[name].tolist()] for name in facts},
    }


def session_of(
    fields: Fields, spacing: NDArray[np.float64], volume: ArrayLike, labels: ArrayLike
) -> Session:
    """Return a session with everything packed, and the IDs of old."""
    table = _facts(fields)
    if not fields.has("given_ids"):
        session = Session(volume, labels, spacing, table)
    else:
        given = fields.array("given_ids", (len(fields.items("given_ids")),)).astype(np.int64)
        compact, present = compact_labels(np.asarray(labels))
        order = np.argsort(given, kind="stable")
        place = np.searchsorted(given[order], present).clip(max=len(given) - 1)
        own = order[place]
        if len(given) > 65536 or not np.array_equal(given[own], present):
            raise ValueError("session.objects.given_ids must be those of the labels")
        session = Session(volume, own.astype(np.uint16)[compact], spacing, table)
        session._given_ids = given
    if not np.array_equal(table.index, session.ids):
        raise ValueError("session.objects.ids must be those of the labels")
    session._facts = session._contents.facts = session._facts[list(table.columns)]
    session._most = fields.integer("slots", len(session.ids))
    session._top = fields.integer("largest_id", session.ids[-1])
    if max(session._most, session._top) > 65535:
        raise ValueError("session.objects.slots and largest_id must be at most 65535")
    return session


def _facts(fields: Fields) -> Any:
    import pandas as pd

    ids, columns = fields.items("ids"), fields.columns("columns")
    for name in _NUMBERS.intersection(columns):
        if not all(isinstance(v, int | float) for v in columns[name]):
            raise ValueError(f"session.objects.columns.{name} must hold numbers")
    if not _NUMBERS | {"name"} <= columns.keys():
        raise ValueError(f"session.objects.columns must hold {', '.join(sorted(_NUMBERS))}, name")
    try:
        return pd.DataFrame(columns, index=pd.Index(ids, name="id", dtype=np.int64))
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"session.objects is malformed: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    return str(value)
