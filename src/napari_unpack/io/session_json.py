"""A session as plain data, and back: all of it but volume, labels and the steps of undo.

Every part of a session has a pair of functions here. The keys of the records are those of the
first version and stay, so that sessions of every version open.
"""

from __future__ import annotations

import base64
import binascii
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Background, Decorations, TransferFunction, golden_hue
from napari_unpack.appearance.tints import Mode, Rgba
from napari_unpack.geometry.axes import checked_spacing, triple, unit
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.length_unit import MM, LengthUnit
from napari_unpack.geometry.relabeling import compact_labels
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera, View
from napari_unpack.io.answers import answers_from, answers_record
from napari_unpack.io.images import png_bytes
from napari_unpack.io.json_fields import Fields
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session.bag_cut import Cut
from napari_unpack.session.events import LogEntry
from napari_unpack.session.labels import LabelData, object_table, one_line
from napari_unpack.session.measurements import Measurement, SurfacePoint
from napari_unpack.session.session import Session
from napari_unpack.session.state import (
    FLAGS,
    Flag,
    Placement,
    SessionState,
    UnpackingRules,
    ViewState,
)
from napari_unpack.session.validation import (
    MOST_ID,
    WIDEST,
    checked_labels,
    checked_planes,
    checked_stretch,
    checked_volume,
)
from napari_unpack.unpacking import Queue
from napari_unpack.unpacking.occlusion import Rule

# Columns that the plugin reads; others are a user's own and may hold anything.
_LARGEST = sys.float_info.max
_NUMBERS = frozenset({"voxels", "volume_mm3", "mean_density", "confidence", "z", "y", "x"})


def _objects_record(data: LabelData) -> dict[str, Any]:
    """Return the facts of objects, and how they are numbered, as plain data."""
    facts, given = data.facts, data.given_ids
    return {
        "ids": [int(i) for i in facts.index],
        "given_ids": None if given is None else given.tolist(),
        "slots": data.most_objects,
        "largest_id": data.largest_id,
        "columns": {str(name): [_plain(v) for v in facts[name].tolist()] for name in facts},
    }


def _label_data_from(
    fields: Fields, volume: NDArray[Any], labels: ArrayLike, spacing: NDArray[np.float64]
) -> LabelData:
    """Make the label data of a record and the labels, which have the IDs they were given with."""
    table = _facts(fields)
    given_ids = None
    if not fields.has("given_ids"):
        own, given_ids = checked_labels(labels, volume.shape)
    else:
        given_ids = fields.given_ids("given_ids")
        # IDs must come out as they were, so labels are not numbered anew.
        compact, present = compact_labels(np.asarray(labels))
        order = np.argsort(given_ids, kind="stable")
        place = np.searchsorted(given_ids[order], present).clip(max=len(given_ids) - 1)
        known = 0 < len(given_ids) <= MOST_ID + 1
        ids = order[place] if known else place
        if not known or not np.array_equal(given_ids[ids], present):
            raise ValueError("session.objects.given_ids must be those of the labels")
        own, _ = checked_labels(ids.astype(np.uint16)[compact], volume.shape)
    # Measured again: a file is not believed where it can be checked.
    boxes = label_boxes(own)
    facts = object_table(volume, own, boxes, spacing, table)[list(table.columns)]
    if not np.array_equal(table.index, boxes.ids):
        raise ValueError("session.objects.ids must be those of the labels")
    slots, largest = _numbers_of_objects(fields, boxes.ids)
    return LabelData(own, boxes, facts, given_ids, largest, slots)


def _numbers_of_objects(fields: Fields, ids: NDArray[np.integer[Any]]) -> tuple[int, int]:
    """Return how many slots there are, and the largest ID there ever was."""
    # IDs of deleted objects are not given again, so the largest is kept apart.
    slots, largest = fields.integer("slots", len(ids)), fields.integer("largest_id")
    if max(slots, largest) > MOST_ID:
        raise ValueError("session.objects.slots and largest_id must be at most 65535")
    if largest < ids[-1]:
        raise ValueError("session.objects.largest_id must be at least that of the labels")
    return slots, largest


def _facts(fields: Fields) -> Any:
    import pandas as pd

    ids, columns = fields.items("ids"), fields.columns("columns")
    for name in _NUMBERS.intersection(columns):
        # JSON's whole numbers have no end.
        if not all(isinstance(v, int | float) and not abs(v) > _LARGEST for v in columns[name]):
            raise ValueError(f"session.objects.columns.{name} must hold numbers")
    if not _NUMBERS | {"name"} <= columns.keys():
        raise ValueError(f"session.objects.columns must hold {', '.join(sorted(_NUMBERS))}, name")
    try:
        return pd.DataFrame(columns, index=pd.Index(ids, name="id", dtype=np.int64))
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"session.objects is malformed: {error}") from error


def _plain(value: Any) -> Any:
    # What stands beside missing ones is left as it was given.
    if isinstance(value, np.generic):
        value = value.item()
    # JSON has neither NaN nor infinity.
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    return str(value)


def _densities_record(function: TransferFunction) -> dict[str, Any]:
    colors = function.colors
    return {
        "points": [list(point) for point in function.points],
        "colors": None if colors is None else [[d, list(rgb)] for d, rgb in colors],
    }


def _densities_from(fields: Fields) -> TransferFunction:
    try:
        return TransferFunction(fields["points"], fields["colors"])
    except (TypeError, IndexError, OverflowError) as error:
        raise ValueError(f"session.situation.transfer_function is malformed: {error}") from error


def _styles_record(styles: Mapping[int, ObjectStyle]) -> dict[str, Any]:
    """Return by ID what objects have of their own."""
    return {
        str(i): {
            "transfer_function": None
            if style.transfer_function is None
            else _densities_record(style.transfer_function),
            "cut": None if style.cut is None else [np.asarray(v).tolist() for v in style.cut],
        }
        for i, style in styles.items()
    }


def _styles_from(fields: Fields, known: frozenset[int]) -> dict[int, ObjectStyle]:
    styles = {}
    for i, value in _told(fields, "studies", known).items():
        one = Fields(value, f"session.situation.studies.{i}")
        own = None
        if one.has("transfer_function"):
            own = _densities_from(one.part("transfer_function"))
        cut = one.array("cut", (2, 3)) if one.has("cut") else None
        if cut is not None and not np.linalg.norm(cut[1]) > 0:
            raise ValueError(f"session.situation.studies.{i}.cut must have a normal that is not 0")
        styles[i] = ObjectStyle(own, None if cut is None else (cut[0], cut[1]))
    return styles


def _measurements_record(measurements: Iterable[Measurement]) -> list[dict[str, Any]]:
    return [
        {"points": [{"object": point.object_id, "at": list(point.at)} for point in one.points]}
        for one in measurements
    ]


def _measurements_from(fields: Fields, known: frozenset[int]) -> tuple[Measurement, ...]:
    # Older files say nothing of them.
    parts = fields.parts("measurements") if fields.has("measurements") else ()
    return tuple(
        Measurement(tuple(_point(point, known) for point in one.parts("points"))) for one in parts
    )


def _point(fields: Fields, known: frozenset[int]) -> SurfacePoint:
    at = triple(fields.array("at", (3,)))
    # Repairs undone since may have been saved with points of what is no object any more: those
    # are points of the scan.
    object_id = fields.integer("object")
    return SurfacePoint(object_id if object_id in known else 0, at)


def state_record(session: Session) -> dict[str, Any]:
    """Return a session's state as plain data; what is in the air counts as landed."""
    now = session.state
    queue = now.queue
    return {
        "transfer_function": _densities_record(now.transfer_function),
        "studies": _styles_record(
            # Of objects merged or deleted since too, for undo: on opening they would be refused.
            {i: style for i, style in now.styles.items() if i in session.label_data.known}
        ),
        "measurements": _measurements_record(now.measurements),
        "answers": answers_record(now.answers),
        "hues": {str(i): hue for i, hue in now.hues.items()},
        "names": {str(i): name for i, name in now.names.items()},
        "colors": {str(i): list(color) for i, color in now.colors.items()},
        "notes": {str(i): note for i, note in now.notes.items()},
        "flags": {str(i): flag for i, flag in now.flags.items()},
        "out": [_placement(i, placement) for i, placement in now.placements.items()],
        "ahead": [[_placement(i, b) for i, b in departure.items()] for departure in now.undone],
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
            "by_these_rules": queue.rules == session.rules.terms,
        },
    }


def _state_from(fields: Fields, data: LabelData, rules: UnpackingRules) -> SessionState:
    """Make the state a record was made of, given its labels and the rules of then."""
    known = data.known
    # What a file does not name gets the hue of a new session.
    hues = {i: golden_hue(i) for i in data.ids}
    for i, hue in fields.by_id("hues", known).items():
        if not isinstance(hue, int | float) or not 0.0 <= hue <= 1.0:
            raise ValueError(f"session.situation.hues.{i} must be from 0 to 1, got {hue!r}")
        hues[i] = float(hue) % 1.0
    names = {i: one_line(str(name)) for i, name in fields.by_id("names", known).items()}
    most = data.most_objects
    placements = dict(_read_placement(part, known, most) for part in fields.parts("out"))
    # Two in one slot would hide each other.
    slots = [placement.slot for placement in placements.values()]
    if len(set(slots)) != len(slots):
        raise ValueError("session.situation.out must give every object a slot of its own")
    hidden = frozenset(fields.ids("hidden", known))
    inspected = fields.integer("inspected") if fields.has("inspected") else None
    # A hidden object cannot be inspected: there would be nothing to see.
    if inspected is not None and inspected not in known - hidden:
        raise ValueError(f"session.situation.inspected must be an object in sight, got {inspected}")
    return SessionState(
        transfer_function=_densities_from(fields.part("transfer_function")),
        styles=_styles_from(fields, known),
        measurements=_measurements_from(fields, known),
        answers=answers_from(fields),
        hues=hues,
        names=names,
        colors=_colors_from(fields, known),
        notes={i: str(note) for i, note in _told(fields, "notes", known).items()},
        flags=_flags_from(fields, known),
        placements=placements,
        undone=tuple(_read_undone(fields, known, most, placements)),
        hidden=hidden,
        examples=frozenset(fields.ids("good", known)) if fields.has("good") else frozenset(),
        inspected=inspected,
        direction=_read_direction(fields),
        queue=_read_queue(fields.part("queue"), rules, known),
    )


def _told(fields: Fields, name: str, known: frozenset[int]) -> dict[int, Any]:
    # Files of before people could colour, note, flag and study objects do not say it.
    return fields.by_id(name, known) if fields.has(name) else {}


def _colors_from(fields: Fields, known: frozenset[int]) -> dict[int, Rgba]:
    found: dict[int, Rgba] = {}
    for i in _told(fields, "colors", known):
        values = fields.part("colors").array(str(i), (4,))
        if values.min() < 0 or values.max() > 1:
            raise ValueError(f"session.situation.colors.{i} must be from 0 to 1, got {values}")
        red, green, blue, opacity = (float(v) for v in values)
        found[i] = red, green, blue, opacity
    return found


def _flags_from(fields: Fields, known: frozenset[int]) -> dict[int, Flag]:
    found = _told(fields, "flags", known)
    return {i: fields.part("flags").text(str(i), FLAGS) for i in found}  # type: ignore[misc]


def _placement(object_id: int, placement: Placement) -> dict[str, Any]:
    placed = placement.placed
    return {
        "id": object_id,
        "slot": placement.slot,
        "rotation": placement.rotation.tolist(),
        "picture_mm": list(placement.image_mm),
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


def _read_undone(
    fields: Fields, known: frozenset[int], slots: int, out: Mapping[int, Placement]
) -> list[dict[int, Placement]]:
    found, seen = [], set(out)
    for k, _ in enumerate(fields.items("ahead")):
        departure = Fields({"ahead": fields["ahead"][k]}, f"session.situation.ahead[{k}]")
        placements = dict(_read_placement(part, known, slots) for part in departure.parts("ahead"))
        # `go_to` would take an object out twice.
        if seen.intersection(placements):
            raise ValueError("session.situation.ahead must name nobody who is out already")
        seen.update(placements)
        found.append(placements)
    return found


def _read_queue(fields: Fields, rules: UnpackingRules, known: frozenset[int]) -> Queue:
    direction = triple(fields.array("direction", (3,))) if fields.has("direction") else None
    return Queue(
        fields.groups("groups", known),
        direction,
        fields.ids("restored", known),
        fields.flag("least_occluded"),
        frozenset(fields.ids("packed", known)),
        # A queue made by other rules is kept, but marked as stale.
        rules.terms if fields.flag("by_these_rules") else (),
    )


def _read_direction(fields: Fields) -> str | tuple[float, float, float] | None:
    if not fields.has("direction"):
        return None
    if isinstance(fields["direction"], str):
        return fields.text("direction", ("up",))
    return triple(fields.array("direction", (3,)))


def _cut_record(cut: Cut) -> dict[str, Any] | None:
    parts = {"plane": cut.plane, "box": cut.box}
    told = {name: pair.tolist() for name, pair in parts.items() if pair is not None}
    return told or None


def _cut_from(fields: Fields) -> Cut:
    plane = fields.array("plane", (2, 3)) if fields.has("plane") else None
    box = fields.array("box", (2, 3)) if fields.has("box") else None
    if plane is not None:
        plane = np.stack([plane[0], unit(plane[1], "session.look.cut.plane")])
    if box is not None and not (box[0] < box[1]).all():
        raise ValueError("session.look.cut.box must have its lower corner below its upper one")
    return Cut(plane, box)


def _decorations_record(around: Decorations) -> dict[str, Any]:
    """Return surroundings as an object of what JSON knows; a picture as PNG in base 64."""
    ground = around.background
    return {
        "name": ground.name,
        "colors": [list(color) for color in ground.colors],
        "picture": None if ground.image is None else _encoded(ground.image),
        "box": around.box,
        "scale": around.scale,
        "measurements": around.measurements,
        "unit": {"name": around.unit.name, "per_mm": float(around.unit.per_mm)},
    }


def _decorations_from(fields: Fields) -> Decorations:
    count = len(fields.items("colors"))
    if count not in (1, 2):
        raise ValueError(f"colors must be one or two, got {count}")
    # Rounding of saved floats may leave them a little outside.
    colors = np.clip(fields.array("colors", (count, 4)), 0.0, 1.0)
    picture = _decoded(fields.text("picture")) if fields.has("picture") else None
    ground = Background(
        tuple((float(r), float(g), float(b), float(a)) for r, g, b, a in colors),
        picture,
        fields.text("name"),
    )
    # Files of before the choice are in mm.
    unit = MM
    if fields.has("unit"):
        told = fields.part("unit")
        unit = LengthUnit(told.text("name"), told.positive("per_mm"))
    # Files of before always drew what was measured.
    measured = fields.flag("measurements") if fields.has("measurements") else True
    return Decorations(ground, fields.flag("box"), fields.flag("scale"), unit, measured)


def _encoded(picture: Any) -> str:
    return base64.b64encode(png_bytes(picture)).decode()


def _decoded(text: str) -> Any:
    import imageio.v3 as iio

    try:
        picture = np.asarray(iio.imread(base64.b64decode(text, validate=True), plugin="pillow"))
    except (binascii.Error, OSError, ValueError, SyntaxError) as error:
        raise ValueError("picture must be a PNG in base 64") from error
    return Background.of(picture).image


def _camera_record(camera: Camera) -> dict[str, Any]:
    return {
        "rotation": camera.rotation.tolist(),
        "center": camera.center.tolist(),
        "height": camera.height,
        "fov": camera.fov,
        "stretch": camera.stretch.tolist(),
    }


def _camera_from(fields: Fields) -> Camera:
    return Camera(
        fields.rotation(),
        fields.array("center", (3,)),
        fields.positive("height"),
        _angle(fields),
        _stretch(fields) if fields.has("stretch") else np.eye(3),
    )


def _view_record(view: View) -> dict[str, Any]:
    return {
        "direction": list(view.direction),
        "up": None if view.up is None else list(view.up),
        "center": None if view.center is None else list(view.center),
        "height": view.height,
        "fov": view.fov,
    }


def _view_from(fields: Fields) -> View:
    def vector(name: str) -> tuple[float, float, float] | None:
        return triple(fields.array(name, (3,))) if fields.has(name) else None

    height = fields.positive("height") if fields.has("height") else None
    direction = vector("direction") or (0.0, 0.0, 1.0)
    return View(direction, vector("up"), vector("center"), height, _angle(fields))


def _stretch(fields: Fields) -> NDArray[np.float64]:
    return checked_stretch(fields.array("stretch", (3, 3)), "session.camera.stretch", 1e-3)


def _angle(fields: Fields) -> float:
    fov = fields.number("fov")
    if not 0.0 <= fov < 170.0:
        raise ValueError(f"session.camera.fov must be in [0, 170), got {fov}")
    return fov


def record_of(session: Session) -> dict[str, Any]:
    """Return a session as what JSON knows, floats exact; what is in the air counts as landed."""
    view, rules, place = session.view_state, session.rules, session.scanner_from_scan
    return {
        "spacing": session.spacing.tolist(),
        "scanner_from_scan": None if place is None else place.tolist(),
        "assumed": list(session.assumed),
        "situation": state_record(session),
        "rules": {
            "rule": rules.rule,
            "tolerance": rules.tolerance,
            "most_in_group": rules.max_group_size,
            "take_least_occluded": rules.take_least_occluded,
        },
        "look": {
            "tint_mode": view.tint_mode,
            "show_unlabelled": view.show_unlabelled,
            "locked_hues": sorted(view.locked_hues & session.label_data.known),
            "hue_margin": view.hue_margin,
            "colored": view.recolored,
            "clipping": view.clipping.tolist(),
            "cut": _cut_record(session.state.cut),
            "surroundings": _decorations_record(view.decorations),
        },
        "camera": _camera_record(view.camera),
        "view": _view_record(view.view),
        "canvas_size": list(view.canvas_size),
        "seconds": session.seconds,
        "away_from_table": view.up.tolist(),
        "selected": sorted(view.selected),
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
        "objects": _objects_record(session.label_data),
    }


def work_of(session: Session) -> object:
    """Return what a person has done in a session, to be compared with what it was before.

    Not how the bag is looked at, nor what follows from that by itself, such as hues.
    """
    state, view = state_record(session), session.view_state
    for by_itself in ("hues", "queue", "inspected"):
        del state[by_itself]
    ground, image = view.decorations.background, view.decorations.background.image
    shown = (view.tint_mode, view.show_unlabelled, view.locked_hues, view.hue_margin)
    drawn = view.decorations
    around = (ground.name, ground.colors, drawn.box, drawn.scale, drawn.unit)
    # The edit itself: a stroke may leave all that is written of the objects as it was.
    edit = session.state.labels_edit
    picture = None if image is None else id(image)
    inside = {i: work_of(bag) for i, bag in session.opened_bags.worked_in(session).items()}
    return state, session.rules, shown, around, picture, view.clipping.tolist(), edit, inside


def session_from(record: Mapping[str, Any], volume: ArrayLike, labels: ArrayLike) -> Session:
    """Make the session a record was made of, in exactly that state, with nothing to undo.

    Parameters
    ----------
    record : mapping
        From `record_of`.
    volume : (Z, Y, X) array_like
    labels : (Z, Y, X) array_like of int
        Object IDs, with the IDs they were given with.

    Raises
    ------
    ValueError
        If the record says something that cannot be, naming the field; or as for `Session`.
    """
    fields = Fields(record, "session")
    density, spacing = checked_volume(volume), checked_spacing(fields.array("spacing", (3,)))
    data = _label_data_from(fields.part("objects"), density, labels, spacing)
    return _with_labels(fields, density, data)


def check_record(record: Mapping[str, Any], session: Session) -> None:
    """Refuse a record that no session could be made of; its labels are not measured anew.

    Parameters
    ----------
    record : mapping
        From `record_of`, as JSON reads it.
    session : Session
        That it was made of.
    """
    fields = Fields(record, "session")
    objects = fields.part("objects")
    _facts(objects)
    if objects.has("given_ids"):
        objects.given_ids("given_ids")
    _numbers_of_objects(objects, session.label_data.boxes.ids)
    _with_labels(fields, session.volume, session.label_data)


def _with_labels(fields: Fields, density: NDArray[Any], data: LabelData) -> Session:
    spacing = checked_spacing(fields.array("spacing", (3,)))
    rules = _rules_from(fields.part("rules"))
    state = _state_from(fields.part("situation"), data, rules)
    view_state, look = _view_state_from(fields, data.known), fields.part("look")
    if look.has("cut"):
        state = replace(state, cut=_cut_from(look.part("cut")))
    session = Session.of_parts(density, spacing, data, state, view_state, rules)
    session.seconds = fields.positive("seconds")
    # Older files do not tell.
    if fields.has("scanner_from_scan"):
        session.scanner_from_scan = fields.array("scanner_from_scan", (4, 4))
    session.assumed = fields.texts("assumed") if fields.has("assumed") else ()
    session.log.extend(_log(fields))
    return session


def _rules_from(fields: Fields) -> UnpackingRules:
    return UnpackingRules(
        fields.text("rule", get_args(Rule)),  # type: ignore[arg-type]
        fields.number("tolerance"),
        fields.integer("most_in_group", 1),
        fields.flag("take_least_occluded"),
    )


def _view_state_from(fields: Fields, known: frozenset[int]) -> ViewState:
    look = fields.part("look")
    # Checked as numbers first: JSON of other writers may say 600.0.
    height, width = (int(n) for n in fields.array("canvas_size", (2,)))
    if not 0 < min(height, width) <= max(height, width) <= WIDEST:
        raise ValueError(f"session.canvas_size must be from 1 to {WIDEST}, got {height, width}")
    # Older files do not say some things: what they lack is as in a new session.
    told: dict[str, Any] = {}
    if look.has("surroundings"):
        told["decorations"] = _decorations_from(look.part("surroundings"))
    if fields.has("away_from_table"):
        told["up"] = unit(fields.array("away_from_table", (3,)), "away_from_table")
    return ViewState(
        view=_view_from(fields.part("view")),
        camera=_camera_from(fields.part("camera")),
        canvas_size=(height, width),
        selected=frozenset(fields.ids("selected", known)),
        clipping=checked_planes(look.array("clipping", (len(look.items("clipping")), 2, 3))),
        tint_mode=look.text("tint_mode", get_args(Mode)),  # type: ignore[arg-type]
        show_unlabelled=look.flag("show_unlabelled"),
        locked_hues=frozenset(look.ids("locked_hues", known)),
        hue_margin=look.number("hue_margin"),
        recolored=look.flag("colored"),
        **told,
    )


def given_labels(session: Session) -> NDArray[Any]:
    """Return the (Z, Y, X) labels with the IDs they came with."""
    given = session.label_data.given_ids
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
