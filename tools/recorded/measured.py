"""What is recorded: everything the public functions return, on a few simulated bags.

Public names alone, so that it runs before and after every move: those of `napari_unpack` and of
DESIGN.md section 5. The few attributes of a session beyond them stand in `BEYOND`.
"""

from __future__ import annotations

import colorsys
import json
import subprocess
import sys
import tempfile
import traceback
import zipfile
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from signatures import ENTRY

import napari_unpack as nu

Entry = tuple[str, Any]
HERE = Path(__file__).parent

BACKENDS = ("cpu", "gl")
DEFINITIONS = ("first_hit", "exact", "eq2", "first_hit_bbox", "listing")
DIRECTIONS: dict[str, Any] = {
    "none": None,
    "up": "up",
    "axis": (0.0, 0.0, 1.0),
    "oblique": (0.3, -0.8, 0.5),
}
OBLIQUE = (0.5, 0.6, -0.62)
RAISED = "an error"

BEYOND = {
    "backend": "backend",
    "canvas": "canvas_size",
    "split": "split",
    "merge": "merge",
    "delete": "delete",
    "show": "show",
    "go_to": "go_to",
    "labels": "labels",
}
"""Attributes of a session that README.md and DESIGN.md do not name, for renaming in one place."""


@dataclass(frozen=True, eq=False)
class Subject:
    """One bag and the size of its pictures.

    Parameters
    ----------
    name : str
    bag : Bag
        `.volume .labels .spacing .objects`.
    size : (int, int)
        Height and width, pixels.
    also, slow : tuple of str
        Groups that this bag alone is recorded in, and those that take minutes.
    """

    name: str
    bag: Any
    size: tuple[int, int]
    also: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()

    @property
    def ids(self) -> list[int]:
        """Every object, ascending."""
        return [int(i) for i in np.unique(self.bag.labels) if i]

    @property
    def hidden(self) -> list[int]:
        """The objects that some pictures leave out: the largest and another."""
        counts = np.bincount(self.bag.labels.ravel())
        counts[0] = 0
        return sorted({int(counts.argmax()), self.ids[-1]})

    @property
    def tints(self) -> dict[int, tuple[float, float, float, float]]:
        """A colour an object; every fourth is half transparent."""
        return {
            i: (*colorsys.hsv_to_rgb((i * 0.618) % 1.0, 0.8, 1.0), 0.5 if i % 4 == 0 else 1.0)
            for i in self.ids
        }


def subjects(wanted: Set[str]) -> Iterator[Subject]:
    """Yield the bags of bags.json, packed and scanned; all where none is named."""
    for told in json.loads((HERE / "bags.json").read_text()):
        if wanted and told["name"] not in wanted:
            continue
        bag = nu.simulate_bag(
            told["seed"], tuple(told["shape"]), told["count"], tuple(told["spacing"])
        )
        also, slow = tuple(told.get("also", ())), tuple(told.get("slow", ()))
        yield Subject(told["name"], bag, tuple(told["size"]), also, slow)


def views(subject: Subject) -> dict[str, tuple[nu.View, list[int]]]:
    """Return the views that pictures are made from, and who is hidden in them."""
    middle = (np.array(subject.bag.labels.shape) - 1) / 2 * subject.bag.spacing
    z, y, x = (float(v) for v in middle)
    near = nu.View((-0.2, 1.0, 0.3), (1.0, 0.1, 0.0), (z, y, x), 0.6 * y)
    return {
        "front": (nu.View(), []),
        "top": (nu.View((0.0, 1.0, 0.0)), []),
        "oblique": (nu.View(OBLIQUE), []),
        "perspective": (nu.View((-0.4, 0.7, 0.6), fov=35.0), []),
        "near": (near, []),
        "hidden": (nu.View(OBLIQUE), subject.hidden),
    }


def simulation(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield the bag itself: all else rests on it."""
    yield "volume", subject.bag.volume
    yield "labels", subject.bag.labels
    yield "objects", subject.bag.objects


def id_layers(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield object-ID layers, and on the CPU what follows from them: interference and hues."""
    previous = None
    for name, (view, hidden) in views(subject).items():
        for backend in BACKENDS[: 1 + gl]:
            ids = nu.object_id_layers(
                subject.bag.labels, subject.bag.spacing, view, 3, subject.size, hidden, backend
            )
            yield f"{name}/{backend}", ids
            if backend == "cpu":
                for distance in (5, 2.5):
                    yield f"{name}/interference {distance}", nu.interference(ids[:2], distance)
                graph = nu.interference(ids[:2], distance=5)
                yield f"{name}/hues", nu.assign_hues(graph)
                previous = nu.assign_hues(graph, previous)
                yield f"{name}/hues kept", previous
    view = nu.View(OBLIQUE)
    for backend in BACKENDS[: 1 + gl]:
        for peeling, step in (("object", None), ("pixel", 0.45)):
            ids = nu.object_id_layers(
                subject.bag.labels, subject.bag.spacing, view, 2, subject.size,
                backend=backend, step=step, peeling=peeling,
            )  # fmt: skip
            yield f"by {peeling} {step}/{backend}", ids


def pictures(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield tinted pictures, every option of `render` at least once."""
    bag = subject.bag
    function = nu.TransferFunction(
        [(0, 0.0), (328, 0.0), (533, 0.1), (4095, 0.3)],
        [(0, (0.9, 0.9, 1.0)), (1500, (1.0, 0.8, 0.6))],
    )
    planes = np.array([[np.array(bag.labels.shape) / 2.0, (0.4, -1.0, 0.5)]])
    options: dict[str, dict[str, Any]] = {
        "plain": {"tints": None},
        "function": {"transfer_function": function},
        "preset": {"transfer_function": nu.TransferFunction.preset("soft")},
        "unshaded": {"shading": None},
        "fine steps": {"step": 0.6 * min(bag.spacing)},
        "jitter": {"jitter": True},
        "clipped": {"clipping": planes},
        "no matter": {"hidden": [0, *subject.hidden]},
        "decorated": {"background": "daylight", "decorations": ("box", "scale")},
    }
    for backend in BACKENDS[: 1 + gl]:
        shared = {"tints": subject.tints, "size": subject.size, "backend": backend}
        for name, (view, hidden) in views(subject).items():
            image = nu.render(bag.volume, bag.labels, bag.spacing, view, hidden=hidden, **shared)
            yield f"{name}/{backend}", image
        for name, more in options.items():
            view = nu.View(OBLIQUE, fov=20.0 if name == "clipped" else 0.0)
            image = nu.render(bag.volume, bag.labels, bag.spacing, view, **(shared | more))
            yield f"{name}/{backend}", image
    density = bag.volume.astype(np.float32) - 1000
    image = nu.render(
        density, bag.labels, bag.spacing, nu.View(OBLIQUE), size=(96, 96), backend="cpu"
    )
    yield "float density/cpu", image
    yield "table", nu.TransferFunction.default_for(bag.volume).table(256)


def occlusion(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield occlusion ratios by every definition, and by occlusion queries."""
    bag = subject.bag
    for name, (view, hidden) in views(subject).items():
        if name not in ("front", "oblique", "hidden"):
            continue
        for backend in BACKENDS[: 1 + gl]:
            for definition in DEFINITIONS:
                yield (
                    f"{name}/{definition}/{backend}",
                    nu.occlusion_ratios(
                        bag.labels, bag.spacing, view, definition, subject.size, hidden, backend
                    ),
                )
        if gl:
            yield f"{name}/queries/gl", nu.occlusion_ratios(
                bag.labels, bag.spacing, view, "first_hit", subject.size, hidden, "gl",
                method="queries",
            )  # fmt: skip


def picking(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield what lies under a grid of pixels, with contributions."""
    bag, (height, width) = subject.bag, subject.size
    for name, (view, hidden) in views(subject).items():
        found = [
            nu.pick(
                bag.volume, bag.labels, bag.spacing, view, (row, column), subject.size,
                tints=subject.tints, hidden=hidden,
            )
            for row in range(height // 10, height, height // 5)
            for column in range(width // 10, width, width // 5)
        ]  # fmt: skip
        yield name, found


def ready_session(subject: Subject, backend: str = "cpu") -> Any:
    """Return a session seen obliquely."""
    facts = subject.bag.objects[["name", "parent"]].assign(confidence=0.5)
    session = nu.Session(subject.bag.volume, subject.bag.labels, subject.bag.spacing, facts)
    setattr(session, BEYOND["backend"], backend)
    setattr(session, BEYOND["canvas"], (480, 640))
    session.view = nu.View(OBLIQUE)
    return session


def unpacked_whole(session: Any) -> list[Any]:
    """Unpack one after another until nobody can leave; return who could and who did."""
    told: list[Any] = []
    try:
        while True:
            told.append([list(session.unpackable()), list(session.unpack(1))])
            if not told[-1][1]:
                return told
    except ValueError:
        return [*told, "nobody"]


def unpacking(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield orders of unpacking along every kind of direction."""
    for name, direction in DIRECTIONS.items():
        session = ready_session(subject)
        session.direction = direction
        yield f"order/{name}", unpacked_whole(session)
    for backend in BACKENDS[: 1 + gl]:
        session = ready_session(subject, backend)
        yield f"hues/{backend}", session.recolor()
        yield f"unpackable/{backend}", session.unpackable()
    session.view = nu.View((0.1, 0.9, 0.4))
    yield "hues turned", session.recolor()
    yield "hues afresh", session.recolor(keep=False)


def saved(session: Any) -> dict[str, Any]:
    """Return what a saved session says, but how long things took and who wrote it."""
    with tempfile.TemporaryDirectory() as folder:
        path = nu.save_session(session, Path(folder, "s.unpack"))
        with zipfile.ZipFile(path) as archive:
            manifest = json.loads(archive.read("session.json"))
    del manifest["written_by"]
    for entry in manifest["session"]["log"]:
        del entry["seconds"]
    return manifest


def verbs(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield what a session says, and what is saved of it, along a story with every verb."""
    session = ready_session(subject)
    session.recolor()
    yield "new", saved(session)
    yield "unpack 3", [session.unpack(3), session.unpackable()]
    chosen = session.unpackable()[-1]
    yield "unpack one", [session.unpack([chosen]), session.unpackable()]
    yield "restore 2", [session.restore(2), session.unpackable()]
    yield "after", saved(session)
    buried = subject.ids[len(subject.ids) // 2]
    if not any(buried == out["id"] for out in saved(session)["session"]["situation"]["out"]):
        try:
            yield "reveal", [session.reveal(buried, "any"), session.unpackable()]
        except ValueError:
            yield "reveal", "refused"
    session.hide(subject.ids[:2])
    yield "hidden", session.unpackable()
    session.isolate(subject.ids[2:6])
    yield "isolated", [session.unpackable(), saved(session)]
    yield "undone", [session.undo() is not None, session.undo() is not None, session.unpackable()]
    yield "redone", [session.redo() is not None, session.unpackable()]
    session.inspect(subject.ids[-1])
    session.direction = "up"
    yield "up", [session.unpackable(), session.unpack(1), saved(session)]
    getattr(session, BEYOND["show"])()
    yield "steps", [getattr(session, BEYOND["go_to"])(k) for k in (1, 4, 2)]
    yield "at step", saved(session)


def repair(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield labels and facts after a split, a merge and a deletion, and after taking them back."""
    session = ready_session(subject)
    whole = subject.hidden[0]
    points = np.argwhere(subject.bag.labels == whole)
    two = (points[0].tolist(), points[-1].tolist())
    new = getattr(session, BEYOND["split"])(whole, *two)
    yield "split", [new, getattr(session, BEYOND["labels"]), saved(session)]
    rest = [i for i in subject.ids if i != whole]
    kept = getattr(session, BEYOND["merge"])([rest[0], new])
    yield "merge", [kept, getattr(session, BEYOND["labels"]), saved(session)]
    getattr(session, BEYOND["delete"])([rest[-1]])
    yield "delete", [getattr(session, BEYOND["labels"]), session.unpackable(), saved(session)]
    session.undo()
    session.undo()
    yield "undone", [getattr(session, BEYOND["labels"]), session.unpackable()]


def films(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield the frames of a film of two flights, and of a turn with a sprite beside the bag."""
    session = ready_session(subject)
    session.recolor()
    for backend in BACKENDS[: 1 + gl]:
        for kind in ("unpacking", "turntable"):
            yield f"{kind}/{backend}", frames(session, kind, backend)
        session.unpack(2)


def frames(session: Any, kind: str, backend: str) -> list[np.ndarray]:
    """Return the pictures of a short film, (H, W, 3 or 4) uint8 each."""
    import imageio.v3 as iio

    with tempfile.TemporaryDirectory() as folder:
        path = nu.movie(
            session, Path(folder, "film"), 2, (120, 160), 4, 0.8,
            backend=backend, decorations=("box",), kind=kind, turn_seconds=1.0,
        )  # fmt: skip
        return [np.asarray(iio.imread(picture)) for picture in sorted(path.iterdir())]


def segmentation(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield labels, table and scores by the method of default."""
    yield from _segmented(subject, "learned")


def cuts(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield labels, table and scores by the paper's method."""
    yield from _segmented(subject, "cuts")


def _segmented(subject: Subject, method: str) -> Iterator[Entry]:
    bag = subject.bag
    more = {} if method == "learned" else {"method": method}
    found = nu.segment(bag.volume, bag.spacing, **more)
    yield "labels", found.labels
    yield "confidences", found.objects[["confidence"]]
    yield "objects", found.objects
    scores = nu.score(bag.labels, found.labels)
    yield "score", {name: round(float(value), 6) for name, value in scores.items()}
    objects = nu.score_objects(bag.labels, found.labels, bag.spacing, boundary=True)
    yield "score objects", objects
    yield "score by", nu.score_by(objects, bag.objects["kind"].to_dict())


def training(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield the confidence trained on this one bag, as it is saved and loaded again."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "oracle.npz")
        nu.train([subject.bag], seed=3).save(path)
        nu.Oracle.load(path).save(path)
        with np.load(path) as file:
            for name in file.files:
                array = file[name]
                yield name, array.round(6) if array.dtype.kind == "f" else array


def variants(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield labels found in other ways: reduced first, freed of noise, from other foregrounds."""
    bag = subject.bag
    options: dict[str, dict[str, Any]] = {
        "working": {"working": 300_000},
        "grainy": {"grainy": True},
        "mumford-shah": {"foreground": "mumford-shah"},
        "density": {"foreground": 600.0, "supports": False, "shell": False},
    }
    for name, more in options.items():
        yield name, nu.segment(bag.volume, bag.spacing, **more).labels


def command_line(subject: Subject, gl: bool) -> Iterator[Entry]:
    """Yield what commands print and write, about a bag of their own."""
    import imageio.v3 as iio

    def told(*words: str) -> str:
        command = [sys.executable, "-c", ENTRY, *words]
        return subprocess.run(
            command, cwd=folder, check=True, capture_output=True, text=True
        ).stdout

    with tempfile.TemporaryDirectory() as folder:
        bag = ("--shape", "48", "56", "72", "--count", "6", "--seed", "4")
        yield "simulate", told("simulate", "bag.npz", *bag)
        yield "bag.csv", Path(folder, "bag.csv").read_text()
        yield "order", told("order", "bag.npz", "--backend", "cpu", "--direction", "up")
        yield "score", told("score", "bag.npz", "bag.npz", "--table", "bag.csv")
        told("table", "bag.npz", "table.csv", "--backend", "cpu")
        yield "table.csv", Path(folder, "table.csv").read_text()
        told(
            "render", "bag.npz", "bag.png", "--backend", "cpu", "--unpacked", "2",
            "--size", "180", "240", "--box", "--background", "dusk",
        )  # fmt: skip
        yield "bag.png", np.asarray(iio.imread(Path(folder, "bag.png")))


GROUPS = (
    simulation, id_layers, pictures, occlusion, picking, unpacking, verbs, repair, films,
    training, segmentation, cuts,
)  # fmt: skip
"""What is recorded of every bag, the slow last."""

MORE_GROUPS = (variants, command_line)
"""What is recorded of those that bags.json names."""


def entries(gl: bool, slow: bool, only: Sequence[str] = ()) -> Iterator[Entry]:
    """Yield everything recorded as (name, value).

    Parameters
    ----------
    gl : bool
        The graphics backend too.
    slow : bool
        What takes minutes too.
    only : sequence of str
        Names of bags and groups; by default all.

    Yields
    ------
    (str, object)
        "bag/group/what"; what is `RAISED` where the group went no further.
    """
    names = {group.__name__ for group in (*GROUPS, *MORE_GROUPS)}
    wanted, bags = names.intersection(only) or names, set(only) - names
    for subject in subjects(bags):
        for group in (*GROUPS, *MORE_GROUPS):
            name = group.__name__
            here = group in GROUPS or name in subject.also
            if not (here and name in wanted and (slow or name not in subject.slow)):
                continue
            try:
                for what, value in group(subject, gl):
                    yield f"{subject.name}/{name}/{what}", value
            # One group that breaks hides nothing of the others.
            except Exception as error:
                traceback.print_exc()
                yield f"{subject.name}/{name}/{RAISED}", repr(error)
