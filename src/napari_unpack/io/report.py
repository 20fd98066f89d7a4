"""The table of objects as a report: a CSV file, or one web page with an image of each object.

The page sorts and searches itself, has a light and a dark theme, and fetches nothing.
"""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import check_writable, checked_target, written_atomically
from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit, VolumeUnit, density_text
from napari_unpack.geometry.transforms import Pose
from napari_unpack.io.headless import snapshot
from napari_unpack.io.images import png_bytes, straight_bytes
from napari_unpack.io.table_page import PageColumn, PageParts, number_cell, table_page
from napari_unpack.rendering.compose import scene_image, sprite_image
from napari_unpack.rendering.cpu import CANCELLING
from napari_unpack.session.errors import percent
from napari_unpack.session.framing import fitted
from napari_unpack.session.state import ObjectState
from napari_unpack.tasks import Progress, Share, no_progress

if TYPE_CHECKING:
    import pandas as pd

    from napari_unpack.session import Session
    from napari_unpack.session.measurements import Measurement

SIDE = 112
"""Longer side of an object's image, CSS pixels; rendered twice as large for dense screens."""

BAG = (600, 960)
"""Height and width of the image of the bag, pixels."""

# What is in the air counts as landed: a page shows no moment.
WORDS = {
    ObjectState.PACKED: "in the bag",
    ObjectState.FLYING_OUT: "unpacked",
    ObjectState.UNPACKED: "unpacked",
    ObjectState.FLYING_BACK: "in the bag",
    ObjectState.INSPECTED: "inspected",
    ObjectState.HIDDEN: "hidden",
}
COLUMNS = (
    PageColumn("Picture", ""),
    PageColumn("ID", "n", "whole"),
    PageColumn("Name", "t", "part"),
    PageColumn("State"),
    PageColumn("Order out", "n"),
    PageColumn("Volume {volume}", "n"),
    PageColumn("Size {length}", "n"),
    PageColumn("Mean density", "n"),
    PageColumn("Confidence", "n"),
    PageColumn("Flag", "t", "part"),
    PageColumn("Note", "t", "part"),
)


def save_objects_page(
    session: Session,
    path: str | Path,
    title: str = "Packed bag",
    progress: Progress | None = None,
    backend: str = "auto",
    planned: bool = False,
) -> Path:
    """Write the table of objects as one self-contained HTML file.

    Parameters
    ----------
    session : Session
        Its objects as they stand. Not changed: a copy is rendered, so this may run on any thread.
    path : str or Path
        .html; its folder must exist.
    title : str
        What the page is called.
    progress : callable, optional
        Takes (fraction, text); raising in it cancels and leaves no file.
    backend : {"auto", "cpu", "gl"}
    planned : bool
        Tell the order of steps that were taken back as well.

    Raises
    ------
    ValueError
        If the file is to be no .html.
    """
    target = checked_target(path, ".html", ".htm")
    check_writable(target)
    report = progress or no_progress
    report(0.0, "Drawing the bag")
    # A copy may be drawn on a worker thread while the user goes on.
    shown = snapshot(session)
    shown.leave()
    # Framing moves the objects beside the bag, so the scene is described after it.
    shown.canvas_size = BAG
    camera = fitted(shown)
    shown.look(camera)
    with CANCELLING.by(Share(report, 0.0, 0.0, "Drawing the bag")):
        bag = scene_image(shown.scene(), camera, BAG, backend=backend)
    page = _page(title, shown, _data_uri(bag), _rows(shown, report, backend, planned))
    with written_atomically(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    report(1.0, "Written")
    return target


def _page(title: str, session: Session, bag: str, rows: Iterator[str]) -> str:
    out = len(session.poses)
    count = f"{len(session.ids)} objects" + (f", {out} unpacked" if out else "")
    parts = PageParts(
        title,
        f"{count}. Click a column to sort by it.",
        "name, note, flag or ID",
        f'<figure><img src="{bag}" alt="The bag" width="{BAG[1]}" height="{BAG[0]}"></figure>\n',
        _measured(session),
    )
    units = {"volume": volume_unit_of(session).name, "length": session.length_unit.name}
    columns = [replace(one, title=one.title.format(**units)) for one in COLUMNS]
    return table_page(parts, columns, rows)


def _measured(session: Session) -> str:
    told = ((m.words_in(session.length_unit), _names_on(session, m)) for m in session.measurements)
    rows = "\n".join(f"<tr><td>{words}</td><td>{escape(on)}</td></tr>" for words, on in told)
    if not rows:
        return ""
    return f"""<h2>Measurements</h2>
<div class="wide"><table>
<thead><tr><th scope="col">Measured</th><th scope="col">On</th></tr></thead>
<tbody>
{rows}
</tbody>
</table></div>
"""


def _names_on(session: Session, measured: Measurement) -> str:
    names = session.objects["name"]
    return ", ".join(str(names[i]) for i in sorted(measured.objects) if i in names.index)


def _rows(session: Session, progress: Progress, backend: str, planned: bool) -> Iterator[str]:
    objects, volumes = said_of_objects(session), volume_unit_of(session)
    # Steps up to now: those undone are still in the bag.
    steps = session.steps if planned else session.steps[: session.step]
    left = {i: k for k, group in enumerate(steps, 1) for i in group}
    for k, i in enumerate(session.ids):
        facts = objects.loc[i]
        text = f"Drawing objects: {k} of {len(session.ids)}"
        share = Share(progress, k / len(session.ids), (k + 1) / len(session.ids), text)
        share()
        edges = session.bag.oriented(i).size
        # The colour alone, without the dimming it may have in the scene.
        red, green, blue = (round(255 * float(v)) for v in session.solo_tints(i)[i, :3])
        # Names come from users and files.
        name = escape(str(facts["name"]))
        swatch = f'<i style="background:rgb({red},{green},{blue})"></i>'
        sure = float(facts.get("confidence", math.nan))
        with CANCELLING.by(share.part(0.3, 1.0)):
            image = _image(session, i, backend)
        yield (
            f'<tr><td class="picture"><img src="{image}" alt="{name}"></td>'
            + number_cell(session.label_of(i), str(session.label_of(i)))
            + f'<td class="name">{swatch}{name}</td>'
            + f"<td>{WORDS[session.states[i]]}</td>"
            + number_cell(left.get(i), str(left.get(i, "")))
            + number_cell(facts["volume_mm3"], volumes.text(float(facts["volume_mm3"])))
            # Sorted by the longest edge, though all three are shown.
            + number_cell(edges[0], session.length_unit.edges(edges))
            + number_cell(facts["mean_density"], density_text(facts["mean_density"]))
            + number_cell(sure, "–" if math.isnan(sure) else percent(sure))
            + f"<td>{escape(str(facts.get('flag', '')))}</td>"
            + f'<td class="{"long" if facts.get("note") else ""}">'
            + f"{escape(str(facts.get('note', '')))}</td>"
            + "</tr>"
        )


def said_of_objects(session: Session) -> pd.DataFrame:
    """Return the facts of a session's objects, with no flag and no note where nobody said one."""
    return session.objects.fillna({"flag": "", "note": ""})


def volume_unit_of(session: Session) -> VolumeUnit:
    """Return the unit in which the volumes of a session's objects are told."""
    return session.length_unit.volume_unit(float(session.objects["volume_mm3"].max()))


def _image(session: Session, object_id: int, backend: str) -> str:
    placement = session.state.placements.get(object_id) or session.bag.placement(
        session.camera, object_id, 0, (object_id,), session.unpack_direction
    )
    # As the user turned it in the end, not as it came to its slot.
    held = placement.rotation if placement.placed is None else placement.placed.rotation
    pose = Pose(np.zeros(3), held, 1.0, session.camera.stretch)
    # Fitted to the longest side in any turn, so that a page does not jump when one is turned.
    pixels = 2 * SIDE / max(placement.turned_mm or placement.image_mm)
    patch = sprite_image(session.scene(), object_id, pose, pixels, backend=backend)
    return _data_uri(patch.rgba if not patch.is_empty else np.zeros((2, 2, 4), np.float32))


def _data_uri(image: NDArray[Any] | Sequence[Any]) -> str:
    encoded = png_bytes(straight_bytes(np.asarray(image)))
    return f"data:image/png;base64,{base64.b64encode(encoded).decode('ascii')}"


def save_objects_csv(
    objects: Session | pd.DataFrame, path: str | Path, unit: LengthUnit = MM
) -> Path:
    """Write a table of objects, one row an object, the ID first.

    Measures have six digits, other numbers the fewest that are no other number. Centres in voxels
    count the voxels along each axis, from the middle of the first.

    Parameters
    ----------
    objects : Session or DataFrame
        A session, whose labels' IDs are written; or a table indexed by ID, such as
        `Segmentation.objects`.
    path : str or Path
        The file; its folder must exist.
    unit : LengthUnit
        Of volumes, centres and ratios of a table alone, whose voxels are taken for cubes; a
        session has its own. Other units than mm stand in the names of these columns: z is then
        z_um or z_voxels.
    """
    import pandas as pd

    if isinstance(objects, pd.DataFrame):
        table = _in_unit(objects, unit, np.full(3, unit.per_mm))
    else:
        table = _in_unit(_by_label(objects), objects.length_unit, _per_mm_of_axes(objects))
    target = checked_target(path)
    with written_atomically(target) as temporary:
        _write_csv(table, temporary, "id")
    return target


def _by_label(session: Session) -> pd.DataFrame:
    """Return what is known of objects, by the IDs that people are shown."""
    table, ids = session.objects, [session.label_of(i) for i in session.ids]
    # Where the session numbers the objects anew, it has a column of these IDs.
    if ids != list(table.index) and "label" in table and ids == list(table["label"]):
        table = table.drop(columns="label")
    return table.set_axis(ids)


def _per_mm_of_axes(session: Session) -> NDArray[np.float64]:
    """Return the factors of places along z, y, x: those in voxels are where arrays have them."""
    unit = session.length_unit
    return 1 / session.spacing if unit.name == "voxels" else np.full(3, unit.per_mm)


def save_measurements_csv(session: Session, path: str | Path) -> Path:
    """Write what was measured, one row a measurement, in the session's unit of lengths.

    Ends in voxels count the voxels along each axis, from the middle of the first.

    Parameters
    ----------
    session : Session
        Its rulers and angles.
    path : str or Path
        The file; its folder must exist.
    """
    import pandas as pd

    unit = session.length_unit
    suffix = _suffix(unit)
    rows = []
    for one in session.measurements:
        lengths = [mm * unit.per_mm for mm in one.lengths]
        row = {
            "kind": "length" if one.angle is None else "angle",
            f"length_{suffix}": lengths[0],
            f"second_length_{suffix}": lengths[1] if len(lengths) > 1 else None,
            "angle_degrees": one.angle,
            "objects": _names_on(session, one),
        }
        for k, end in enumerate(one.ends * _per_mm_of_axes(session), 1):
            row |= {f"{axis}{k}_{suffix}": v for axis, v in zip("zyx", end, strict=True)}
        rows.append(row)
    ends = [f"{axis}{k}_{suffix}" for k in (1, 2, 3) for axis in "zyx"]
    told = [f"length_{suffix}", f"second_length_{suffix}", "angle_degrees", "objects", *ends]
    table = pd.DataFrame(rows, index=range(1, len(rows) + 1), columns=["kind", *told])
    target = checked_target(path)
    with written_atomically(target) as temporary:
        _write_csv(table.map(_six_digits), temporary, "measurement")
    return target


def _write_csv(table: pd.DataFrame, path: Path, index: str) -> None:
    # A column of a person's own may have that name too.
    own = index
    while own in table:
        own = f"own_{own}"
    table = table.rename(columns={index: own})
    table.apply(_cells).to_csv(path, index_label=index, lineterminator="\n")


def _cells(column: pd.Series[Any]) -> pd.Series[Any]:
    import pandas as pd

    # Not by `map`, which makes float64 of float32, and noise of its last digits.
    return pd.Series([_cell(v) for v in column.array], column.index)


def _cell(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        # The fewest digits that are this number; whole ones beside missing ones are floats too.
        return "" if np.isnan(value) else str(value).removesuffix(".0")
    if not isinstance(value, str):
        return value
    # One line end on every system, since a lone carriage return is not quoted and ends the row for
    # whoever reads it.
    text = re.sub("\r\n?", "\n", value)
    # Spreadsheets run text that begins so; an apostrophe makes it text, and is not shown.
    return f"'{text}" if value[:1] in set("=+-@\t\r") else text


def _six_digits(value: Any) -> Any:
    # More than any measure has; numbers of a person's own keep theirs.
    return float(f"{value:.6g}") if isinstance(value, float | np.floating) else value


def _suffix(unit: LengthUnit) -> str:
    return "um" if unit.name == MICRO else unit.name


def _in_unit(
    objects: pd.DataFrame, unit: LengthUnit, per_mm_of_axes: NDArray[np.float64]
) -> pd.DataFrame:
    factors = dict(zip("zyx", per_mm_of_axes, strict=True)) | {
        "volume_mm3": unit.per_mm**3,
        "isoperimetric_ratio": 1 / unit.per_mm,
        "mean_density": 1,
        "confidence": 1,
    }
    told = {
        name: (objects[name] * factor).map(_six_digits)
        for name, factor in factors.items()
        if name in objects
    }
    table = objects.assign(**told)
    # As they have always been called.
    if unit.name == "mm":
        return table
    suffix = _suffix(unit)
    names = {axis: f"{axis}_{suffix}" for axis in "zyx"} | {
        "volume_mm3": "volume_voxels" if unit.name == "voxels" else f"volume_{suffix}3",
        "isoperimetric_ratio": f"isoperimetric_ratio_per_{suffix}",
    }
    return table.rename(columns=names)
