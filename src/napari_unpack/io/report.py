"""The table of objects as a report: a CSV file, or one web page with an image of each object.

The page sorts and searches itself, has a light and a dark theme, and fetches nothing.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import check_writable, checked_target, written_atomically
from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit, VolumeUnit
from napari_unpack.geometry.transforms import Pose
from napari_unpack.io.headless import copy_session, frame_bag
from napari_unpack.io.images import straight_bytes
from napari_unpack.rendering.compose import scene_image, sprite_image
from napari_unpack.session.errors import percent
from napari_unpack.session.state import ObjectState
from napari_unpack.tasks import Progress, no_progress

if TYPE_CHECKING:
    import pandas as pd

    from napari_unpack.session import Session
    from napari_unpack.session.measurements import Measurement

STYLE = """
:root { color-scheme: light dark; --ground: #fbfbfc; --raised: #ffffff; --ink: #1c2128;
  --faint: #626b78; --line: #dfe3e8; --well: #14181f; --accent: #0b6bcb; }
@media (prefers-color-scheme: dark) {
  :root { --ground: #14171c; --raised: #1c2027; --ink: #e6e9ee; --faint: #98a2b1;
    --line: #2e343e; --well: #0d1014; --accent: #6cb2ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1080px; padding: 32px 20px 48px; background: var(--ground);
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
h1 { font-size: 26px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 18px; margin: 28px 0 10px; }
p, footer { color: var(--faint); margin: 0; }
figure { margin: 20px 0; }
figure img { display: block; width: 100%; height: auto; border-radius: 10px; }
.search { display: block; color: var(--faint); margin: 0 0 12px; }
input { font: inherit; color: var(--ink); background: var(--raised); padding: 5px 10px;
  border: 1px solid var(--line); border-radius: 6px; margin-left: 8px; width: 240px; }
.wide { overflow-x: auto; border: 1px solid var(--line); border-radius: 10px;
  background: var(--raised); }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 8px 12px; text-align: left; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
tbody tr:last-child td { border-bottom: 0; }
th { font-weight: 600; font-size: 13px; color: var(--faint); position: sticky; top: 0;
  background: var(--raised); }
th[data-kind=n], .n { text-align: right; font-variant-numeric: tabular-nums; }
th button { all: unset; cursor: pointer; }
th button:hover, th[aria-sort$=ending] button { color: var(--accent); }
th button:focus-visible { outline: 2px solid var(--accent); outline-offset: 3px; }
th[aria-sort=ascending] button::after { content: " \\2191"; }
th[aria-sort=descending] button::after { content: " \\2193"; }
.picture { width: 136px; }
.picture img { display: block; margin: 0 auto; max-width: 112px; max-height: 84px; }
td.picture { background: var(--well); }
td i { display: inline-block; width: 11px; height: 11px; border-radius: 3px;
  margin-right: 9px; }
tbody tr:hover td:not(.picture) { background: color-mix(in srgb, var(--accent) 8%, transparent); }
footer { margin-top: 20px; font-size: 13px; }
@media print { .search, footer { display: none; } .wide { overflow: visible; } }
"""

SCRIPT = """
"use strict";
const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll("th")];
const texts = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });
heads.forEach((head, column) => {
  const button = head.querySelector("button");
  if (!button) return;
  button.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    heads.forEach(other => other.dataset.kind && other.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const number = head.dataset.kind === "n";
    const value = row => number ? row.cells[column].dataset.value : row.cells[column].textContent;
    const rows = [...body.rows].sort((a, b) => {
      const [x, y] = [value(a), value(b)];
      if (number && (x === "" || y === "")) return (x === "") - (y === "");
      return (up ? 1 : -1) * (number ? x - y : texts.compare(x, y));
    });
    body.append(...rows);
  });
});
document.querySelector("input").addEventListener("input", event => {
  const wanted = event.target.value.trim().toLowerCase();
  for (const row of body.rows) {
    const words = [2, 9, 10].map(k => row.cells[k].textContent.toLowerCase());
    const found = row.cells[1].textContent === wanted || words.some(w => w.includes(wanted));
    row.hidden = Boolean(wanted) && !found;
  }
});
"""


SIDE = 112
"""Longer side of an object's image, CSS pixels; rendered twice as large for dense screens."""

BAG = (600, 960)
"""Height and width of the image of the bag, pixels."""

# What is in the air counts as landed: a page shows no moment.
WORDS = {
    ObjectState.PACKED: "in the bag",
    ObjectState.FLYING_OUT: "taken out",
    ObjectState.UNPACKED: "taken out",
    ObjectState.FLYING_BACK: "in the bag",
    ObjectState.INSPECTED: "inspected",
    ObjectState.HIDDEN: "hidden",
}
COLUMNS = (
    ("", "Picture"),
    ("n", "ID"),
    ("t", "Name"),
    ("t", "State"),
    ("n", "Order out"),
    ("n", "Volume {volume}"),
    ("n", "Size {length}"),
    ("n", "Mean density"),
    ("n", "Confidence"),
    ("t", "Flag"),
    ("t", "Note"),
)


def save_objects_page(
    session: Session,
    path: str | Path,
    title: str = "Packed bag",
    progress: Progress | None = None,
    backend: str = "auto",
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
    shown = copy_session(session, packed=False)
    # Framing moves the objects beside the bag, so the scene is described after it.
    camera = frame_bag(shown, BAG)
    bag = scene_image(shown.scene(), camera, BAG, backend=backend)
    rows = "\n".join(_rows(shown, report, backend))
    with written_atomically(target) as temporary:
        temporary.write_text(_page(title, shown, _data_uri(bag), rows), encoding="utf-8")
    report(1.0, "Written")
    return target


def _page(title: str, session: Session, bag: str, rows: str) -> str:
    name = escape(title)
    out = len(session.poses)
    count = f"{len(session.ids)} objects" + (f", {out} taken out" if out else "")
    length, volume = session.length_unit, _volumes(session)
    heads = "".join(
        f'<th scope="col" data-kind="{kind}"{" aria-sort=none" if kind else ""}>'
        + (f"<button>{titled}</button>" if kind else titled)
        + "</th>"
        for kind, words in COLUMNS
        for titled in [words.format(volume=volume.name, length=length.name)]
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{name}</title>
<style>{STYLE}</style>
</head>
<body>
<header>
<h1>{name}</h1>
<p>{count}. Click a column to sort by it.</p>
</header>
<figure><img src="{bag}" alt="The bag" width="{BAG[1]}" height="{BAG[0]}"></figure>
<label class="search">Search <input type="search" placeholder="name, note, flag or ID"></label>
<div class="wide"><table>
<thead><tr>{heads}</tr></thead>
<tbody>
{rows}
</tbody>
</table></div>
{_measured(session)}<footer>Made with napari-unpack.</footer>
<script>{SCRIPT}</script>
</body>
</html>
"""


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


def _rows(session: Session, progress: Progress, backend: str) -> Iterator[str]:
    objects, volumes = session.objects, _volumes(session)
    # Steps up to now: those undone are still in the bag.
    left = {i: k for k, group in enumerate(session.steps[: session.step], 1) for i in group}
    for k, i in enumerate(session.ids):
        facts = objects.loc[i]
        progress(k / len(session.ids), f"Drawing objects: {k} of {len(session.ids)}")
        edges = session.bag.oriented(i).size
        # The colour alone, without the dimming it may have in the scene.
        red, green, blue = (round(255 * float(v)) for v in session.solo_tints(i)[i, :3])
        # Names come from users and files.
        name = escape(str(facts["name"]))
        swatch = f'<i style="background:rgb({red},{green},{blue})"></i>'
        sure = float(facts.get("confidence", math.nan))
        yield (
            f'<tr><td class="picture"><img src="{_image(session, i, backend)}" alt="{name}"></td>'
            + _number(session.label_of(i), str(session.label_of(i)))
            + f"<td>{swatch}{name}</td><td>{WORDS[session.states[i]]}</td>"
            + _number(left.get(i), str(left.get(i, "")))
            + _number(facts["volume_mm3"], volumes.text(float(facts["volume_mm3"])))
            # Sorted by the longest edge, though all three are shown.
            + _number(edges[0], session.length_unit.edges(edges))
            + _number(facts["mean_density"], f"{facts['mean_density']:.0f}")
            + _number(sure, "–" if math.isnan(sure) else percent(sure))
            + f"<td>{escape(str(facts.get('flag', '')))}</td>"
            + f"<td>{escape(str(facts.get('note', '')))}</td>"
            + "</tr>"
        )


def _number(value: Any, words: str) -> str:
    # The page sorts what has no number last, in both orders.
    known = value is not None and math.isfinite(value)
    return f'<td class="n" data-value="{format(value, ".9g") if known else ""}">{words}</td>'


def _volumes(session: Session) -> VolumeUnit:
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
    import imageio.v3 as iio

    encoded = iio.imwrite("<bytes>", straight_bytes(np.asarray(image)), extension=".png")
    return f"data:image/png;base64,{base64.b64encode(encoded).decode('ascii')}"


def save_objects_csv(objects: pd.DataFrame, path: str | Path, unit: LengthUnit = MM) -> Path:
    """Write a table of objects, one row an object, the ID first.

    Parameters
    ----------
    objects : DataFrame
        Indexed by ID, such as `Segmentation.objects` or `Session.objects`.
    path : str or Path
        The file; its folder must exist.
    unit : LengthUnit
        Of volumes, centres and ratios, such as `Session.length_unit`; the names of columns say
        which.
    """
    target = Path(path)
    objects = _in_unit(objects, unit).map(_not_a_formula)
    with written_atomically(target) as temporary:
        _write_csv(objects, temporary, "id")
    return target


def save_measurements_csv(session: Session, path: str | Path) -> Path:
    """Write what was measured, one row a measurement, in the session's unit of lengths.

    Parameters
    ----------
    session : Session
        Its rulers and angles.
    path : str or Path
        The file; its folder must exist.
    """
    import pandas as pd

    unit = session.length_unit
    # As columns of other tables are called.
    suffix = "um" if unit.name == MICRO else unit.name
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
        for k, end in enumerate(one.ends * unit.per_mm, 1):
            row |= {f"{axis}{k}_{suffix}": v for axis, v in zip("zyx", end, strict=True)}
        rows.append(row)
    ends = [f"{axis}{k}_{suffix}" for k in (1, 2, 3) for axis in "zyx"]
    told = [f"length_{suffix}", f"second_length_{suffix}", "angle_degrees", "objects", *ends]
    table = pd.DataFrame(rows, index=range(1, len(rows) + 1), columns=["kind", *told])
    target = Path(path)
    with written_atomically(target) as temporary:
        _write_csv(table.map(_not_a_formula), temporary, "measurement")
    return target


def _write_csv(table: pd.DataFrame, path: Path, index: str) -> None:
    # Six digits are more than any measure has; one line end on every system.
    table.to_csv(path, index_label=index, float_format="%.6g", lineterminator="\n")


def _not_a_formula(value: Any) -> Any:
    # Spreadsheets run text that begins so; an apostrophe makes it text, and is not shown.
    return f"'{value}" if isinstance(value, str) and value[:1] in set("=+-@\t\r") else value


def _in_unit(objects: pd.DataFrame, unit: LengthUnit) -> pd.DataFrame:
    if unit == MM:
        return objects
    names = {"mm": "volume_mm3", "voxels": "volume_voxels"}
    powers = {"volume_mm3": 3, "z": 1, "y": 1, "x": 1, "isoperimetric_ratio": -1}
    told = {name: objects[name] * unit.per_mm**n for name, n in powers.items() if name in objects}
    return objects.assign(**told).rename(columns={"volume_mm3": names.get(unit.name, "volume_um3")})
