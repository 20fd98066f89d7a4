"""Measurements as plain data, and back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from napari_unpack.geometry.axes import triple
from napari_unpack.io.json_fields import Fields
from napari_unpack.session.measurements import Measurement, SurfacePoint


def measurements_record(measurements: Iterable[Measurement]) -> list[dict[str, Any]]:
    """Return measurements as plain data."""
    return [
        {"points": [{"object": point.object_id, "at": list(point.at)} for point in one.points]}
        for one in measurements
    ]


def measurements_from(fields: Fields, known: frozenset[int]) -> tuple[Measurement, ...]:
    """Make the measurements a record was made of; none where older files say nothing of them.

    Parameters
    ----------
    fields : Fields
        The record that has them.
    known : frozenset of int
        The objects of the session: points of others are points of the scan.
    """
    if not fields.has("measurements"):
        return ()
    return tuple(
        Measurement(tuple(_point(point, known) for point in one.parts("points")))
        for one in fields.parts("measurements")
    )


def _point(fields: Fields, known: frozenset[int]) -> SurfacePoint:
    at = triple(fields.array("at", (3,)))
    # Repairs undone since may have been saved with points of what is no object any more.
    object_id = fields.integer("object")
    return SurfacePoint(object_id if object_id in known else 0, at)
