"""A session's situation as plain data, and back: who is where, who leaves next, hues and names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.session.fields import Fields
from napari_unpack.session.session import Session
from napari_unpack.session.state import Berth, Situation
from napari_unpack.session.study_record import (
    densities_from,
    densities_record,
    studies_from,
    studies_record,
)
from napari_unpack.unpacking import Queue


def situation_record(session: Session) -> dict[str, Any]:
    """Return a session's situation as plain data; what is in the air counts as landed."""
    now = session._situation
    queue = now.queue
    return {
        "transfer_function": densities_record(now.transfer_function),
        "studies": studies_record(now.studies),
        "hues": {str(i): hue for i, hue in now.hues.items()},
        "names": {str(i): name for i, name in now.names.items()},
        "out": [_berth(i, berth) for i, berth in now.out.items()],
        "ahead": [[_berth(i, b) for i, b in departure.items()] for departure in now.ahead],
        "hidden": sorted(now.hidden),
        "good": sorted(session.good),
        "inspected": now.inspected,
        "direction": list(now.direction) if isinstance(now.direction, tuple) else now.direction,
        "queue": {
            "groups": [list(group) for group in queue.groups],
            "direction": None if queue.direction is None else list(queue.direction),
            "restored": list(queue.restored),
            "least_occluded": queue.least_occluded,
            "packed": sorted(queue.packed),
            "by_these_rules": queue.terms == session._terms,
        },
    }


def situation_from(fields: Fields, session: Session, known: frozenset[int]) -> Situation:
    """Make the situation a record was made of.

    Parameters
    ----------
    fields : Fields
    session : Session
        With everything packed, and the rules of then.
    known : frozenset of int
        Its objects.

    Raises
    ------
    ValueError
        If it cannot be, naming the field.
    """
    hues = session.hues
    for i, hue in fields.by_id("hues", known).items():
        if not isinstance(hue, int | float) or not 0.0 <= hue <= 1.0:
            raise ValueError(f"session.situation.hues.{i} must be from 0 to 1, got {hue!r}")
        hues[i] = float(hue)
    names = {i: str(name) for i, name in fields.by_id("names", known).items()}
    out = dict(_read_berth(part, known, session._most) for part in fields.parts("out"))
    slots = [berth.slot for berth in out.values()]
    if len(set(slots)) != len(slots):
        raise ValueError("session.situation.out must give every object a slot of its own")
    hidden = frozenset(fields.ids("hidden", known))
    inspected = fields.integer("inspected") if fields.has("inspected") else None
    if inspected is not None and inspected not in known - hidden:
        raise ValueError(f"session.situation.inspected must be an object in sight, got {inspected}")
    return replace(
        session._situation,
        transfer_function=densities_from(fields.part("transfer_function")),
        studies=studies_from(fields, known),
        hues=hues,
        names=names,
        out=out,
        ahead=tuple(_read_ahead(fields, known, session._most, out)),
        hidden=hidden,
        good=frozenset(fields.ids("good", known)) if fields.has("good") else frozenset(),
        inspected=inspected,
        direction=_read_direction(fields),
        queue=_read_queue(fields.part("queue"), session, known),
    )


def _berth(object_id: int, berth: Berth) -> dict[str, Any]:
    placed = berth.placed
    return {
        "id": object_id,
        "slot": berth.slot,
        "rotation": berth.rotation.tolist(),
        "picture_mm": list(berth.picture_mm),
        "direction": np.asarray(berth.direction).tolist(),
        "group": list(berth.group),
        "placed": None
        if placed is None
        else {
            "center": np.asarray(placed.center).tolist(),
            "rotation": np.asarray(placed.rotation).tolist(),
            "scale": float(placed.scale),
        },
        "within": None if berth.within is None else list(berth.within),
        "turned_mm": None if berth.turned_mm is None else list(berth.turned_mm),
    }


def _read_berth(fields: Fields, known: frozenset[int], count: int) -> tuple[int, Berth]:
    object_id, slot = fields.integer("id"), fields.integer("slot")
    group = fields.ids("group", known)
    if object_id not in group or slot >= count:
        raise ValueError(
            f"a departure must name an object of its group and a slot below {count}, got object "
            f"{object_id}, group {group}, slot {slot}"
        )
    placed = None
    if fields.has("placed"):
        part = fields.part("placed")
        placed = Pose(part.array("center", (3,)), part.rotation(), part.positive("scale"))
    direction = fields.array("direction", (3,))
    return object_id, Berth(
        slot,
        fields.rotation(),
        _lengths(fields, "picture_mm"),
        direction,
        group,
        placed,
        _lengths(fields, "within") if fields.has("within") else None,
        _lengths(fields, "turned_mm") if fields.has("turned_mm") else None,
    )


def _lengths(fields: Fields, name: str) -> tuple[float, float]:
    first, second = (float(v) for v in fields.array(name, (2,)))
    if not (first > 0 and second > 0):
        raise ValueError(f"a departure's {name} must be two positive numbers, got {first, second}")
    return first, second


def _read_ahead(
    fields: Fields, known: frozenset[int], slots: int, out: Mapping[int, Berth]
) -> list[dict[int, Berth]]:
    found, seen = [], set(out)
    for k, _ in enumerate(fields.items("ahead")):
        departure = Fields({"ahead": fields["ahead"][k]}, f"session.situation.ahead[{k}]")
        berths = dict(_read_berth(part, known, slots) for part in departure.parts("ahead"))
        if seen.intersection(berths):
            raise ValueError("session.situation.ahead must name nobody who is out already")
        seen.update(berths)
        found.append(berths)
    return found


def _read_queue(fields: Fields, session: Session, known: frozenset[int]) -> Queue:
    direction = None
    if fields.has("direction"):
        z, y, x = (float(v) for v in fields.array("direction", (3,)))
        direction = z, y, x
    return Queue(
        fields.groups("groups", known),
        direction,
        fields.ids("restored", known),
        fields.flag("least_occluded"),
        frozenset(fields.ids("packed", known)),
        session._terms if fields.flag("by_these_rules") else (),
    )


def _read_direction(fields: Fields) -> str | tuple[float, float, float] | None:
    if not fields.has("direction"):
        return None
    if isinstance(fields["direction"], str):
        return fields.text("direction", ("up",))
    z, y, x = (float(v) for v in fields.array("direction", (3,)))
    return z, y, x
