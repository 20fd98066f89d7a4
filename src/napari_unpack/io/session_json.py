"""A session's situation as plain data, and back: who is where, who leaves next, hues and names.

The table of objects as plain data, and a session with everything packed made of it.

Opacities and cuts of objects' own as plain data, and back.

Surroundings as JSON, for saved sessions.

Camera and view as plain data, and back.

A session as plain data, and back: all of it but volume, labels and the steps of undo.
"""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Background, Decorations, TransferFunction
from napari_unpack.appearance.tints import Mode
from napari_unpack.geometry.relabeling import compact_labels
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera, View
from napari_unpack.io.json_fields import Fields
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session.events import LogEntry
from napari_unpack.session.session import Session
from napari_unpack.session.state import Placement, SessionState
from napari_unpack.unpacking import Queue
from napari_unpack.unpacking.occlusion import Rule

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


def densities_record(function: TransferFunction) -> dict[str, Any]:
    """Return a transfer function as plain data."""
    colors = function.colors
    return {
        "points": [list(point) for point in function.points],
        "colors": None if colors is None else [[d, list(rgb)] for d, rgb in colors],
    }


def densities_from(fields: Fields) -> TransferFunction:
    """Make the transfer function a record was made of.

    Raises
    ------
    ValueError
        If there is no such function.
    """
    try:
        return TransferFunction(fields["points"], fields["colors"])
    except (TypeError, IndexError) as error:
        raise ValueError(f"session.situation.transfer_function is malformed: {error}") from error


def studies_record(studies: Mapping[int, ObjectStyle]) -> dict[str, Any]:
    """Return by ID what objects have of their own."""
    return {
        str(i): {
            "transfer_function": None
            if study.transfer_function is None
            else densities_record(study.transfer_function),
            "cut": None if study.cut is None else [np.asarray(v).tolist() for v in study.cut],
        }
        for i, study in studies.items()
    }


def studies_from(fields: Fields, known: frozenset[int]) -> dict[int, ObjectStyle]:
    """Make what `studies_record` was made of; nothing where older files say nothing of it.

    Raises
    ------
    ValueError
        If the record says something that cannot be.
    """
    if not fields.has("studies"):
        return {}
    studies = {}
    for i, value in fields.by_id("studies", known).items():
        one = Fields(value, f"session.situation.studies.{i}")
        own = None
        if one.has("transfer_function"):
            own = densities_from(one.part("transfer_function"))
        cut = one.array("cut", (2, 3)) if one.has("cut") else None
        if cut is not None and not np.linalg.norm(cut[1]) > 0:
            raise ValueError(f"session.situation.studies.{i}.cut must have a normal that is not 0")
        studies[i] = ObjectStyle(own, None if cut is None else (cut[0], cut[1]))
    return studies


def situation_record(session: Session) -> dict[str, Any]:
    """Return a session's situation as plain data; what is in the air counts as landed."""
    now = session._situation
    queue = now.queue
    return {
        "transfer_function": densities_record(now.transfer_function),
        "studies": studies_record(now.studies),
        "hues": {str(i): hue for i, hue in now.hues.items()},
        "names": {str(i): name for i, name in now.names.items()},
        "out": [_placement(i, placement) for i, placement in now.out.items()],
        "ahead": [[_placement(i, b) for i, b in departure.items()] for departure in now.ahead],
        "hidden": sorted(now.hidden),
        "good": sorted(session.examples),
        "inspected": now.inspected,
        "direction": list(now.direction) if isinstance(now.direction, tuple) else now.direction,
        "queue": {
            "groups": [list(group) for group in queue.groups],
            "direction": None if queue.direction is None else list(queue.direction),
            "restored": list(queue.restored),
            "least_occluded": queue.least_occluded,
            "packed": sorted(queue.packed),
            "by_these_rules": queue.rules == session._terms,
        },
    }


def situation_from(fields: Fields, session: Session, known: frozenset[int]) -> SessionState:
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
    out = dict(_read_placement(part, known, session._most) for part in fields.parts("out"))
    slots = [placement.slot for placement in out.values()]
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


def _placement(object_id: int, placement: Placement) -> dict[str, Any]:
    placed = placement.placed
    return {
        "id": object_id,
        "slot": placement.slot,
        "rotation": placement.rotation.tolist(),
        "picture_mm": list(placement.picture_mm),
        "direction": np.asarray(placement.direction).tolist(),
        "group": list(placement.group),
        "placed": None
        if placed is None
        else {
            "center": np.asarray(placed.center).tolist(),
            "rotation": np.asarray(placed.rotation).tolist(),
            "scale": float(placed.scale),
        },
        "within": None if placement.within is None else list(placement.within),
        "turned_mm": None if placement.turned_mm is None else list(placement.turned_mm),
    }


def _read_placement(fields: Fields, known: frozenset[int], count: int) -> tuple[int, Placement]:
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
    return object_id, Placement(
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
    fields: Fields, known: frozenset[int], slots: int, out: Mapping[int, Placement]
) -> list[dict[int, Placement]]:
    found, seen = [], set(out)
    for k, _ in enumerate(fields.items("ahead")):
        departure = Fields({"ahead": fields["ahead"][k]}, f"session.situation.ahead[{k}]")
        placements = dict(_read_placement(part, known, slots) for part in departure.parts("ahead"))
        if seen.intersection(placements):
            raise ValueError("session.situation.ahead must name nobody who is out already")
        seen.update(placements)
        found.append(placements)
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


def surroundings_record(around: Decorations) -> dict[str, Any]:
    """Return surroundings as an object of what JSON knows; a picture as PNG in base 64."""
    ground = around.background
    return {
        "name": ground.name,
        "colors": [list(color) for color in ground.colors],
        "picture": None if ground.image is None else _encoded(ground.image),
        "box": around.box,
        "scale": around.scale,
    }


def surroundings_from(fields: Fields) -> Decorations:
    """Return the surroundings an object was made of.

    Raises
    ------
    ValueError
        If it says something that cannot be.
    """
    count = len(fields.items("colors"))
    if count not in (1, 2):
        raise ValueError(f"colors must be one or two, got {count}")
    colors = np.clip(fields.array("colors", (count, 4)), 0.0, 1.0)
    picture = _decoded(fields.text("picture")) if fields.has("picture") else None
    ground = Background(
        tuple((float(r), float(g), float(b), float(a)) for r, g, b, a in colors),
        picture,
        fields.text("name"),
    )
    return Decorations(ground, fields.flag("box"), fields.flag("scale"))


def _encoded(picture: Any) -> str:
    import imageio.v3 as iio

    return base64.b64encode(iio.imwrite("<bytes>", picture, extension=".png")).decode()


def _decoded(text: str) -> Any:
    import imageio.v3 as iio

    try:
        picture = np.asarray(iio.imread(base64.b64decode(text, validate=True), extension=".png"))
    except (binascii.Error, OSError, ValueError, SyntaxError) as error:
        raise ValueError("picture must be a PNG in base 64") from error
    return Background.of(picture).image


def camera_record(camera: Camera) -> dict[str, Any]:
    """Return a camera as plain data."""
    return {
        "rotation": camera.rotation.tolist(),
        "center": camera.center.tolist(),
        "height": camera.height,
        "fov": camera.fov,
        "stretch": camera.stretch.tolist(),
    }


def camera_from(fields: Fields) -> Camera:
    """Make the camera a record was made of."""
    return Camera(
        fields.rotation(),
        fields.array("center", (3,)),
        fields.positive("height"),
        _angle(fields),
        _stretch(fields) if fields.has("stretch") else np.eye(3),
    )


def view_record(view: View) -> dict[str, Any]:
    """Return a view, as it was asked for, as plain data."""
    return {
        "direction": list(view.direction),
        "up": None if view.up is None else list(view.up),
        "center": None if view.center is None else list(view.center),
        "height": view.height,
        "fov": view.fov,
    }


def view_from(fields: Fields) -> View:
    """Make the view a record was made of."""

    def triple(name: str) -> tuple[float, float, float] | None:
        if not fields.has(name):
            return None
        z, y, x = (float(v) for v in fields.array(name, (3,)))
        return z, y, x

    height = fields.positive("height") if fields.has("height") else None
    direction = triple("direction") or (0.0, 0.0, 1.0)
    return View(direction, triple("up"), triple("center"), height, _angle(fields))


def _stretch(fields: Fields) -> NDArray[np.float64]:
    stretch = fields.array("stretch", (3, 3))
    upright = stretch * np.sign(np.linalg.det(stretch))
    lengths = np.linalg.eigvalsh(upright)
    same = np.allclose(stretch, stretch.T, atol=1e-6)
    if not same or lengths.min() <= 1e-3 or abs(np.prod(lengths) - 1) > 1e-3:
        raise ValueError(
            "session.camera.stretch must be symmetric, definite and of determinant 1 or -1, got "
            f"{stretch.tolist()}"
        )
    return stretch


def _angle(fields: Fields) -> float:
    fov = fields.number("fov")
    if not 0.0 <= fov < 170.0:
        raise ValueError(f"session.camera.fov must be in [0, 170), got {fov}")
    return fov


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
            "most_in_group": session.max_group_size,
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
    session.max_group_size = rules.integer("most_in_group", 1)
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
