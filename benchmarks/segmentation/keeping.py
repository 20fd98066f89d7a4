"""Scores of one volume by one method, kept in files so that a long run can go on where it was."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

import napari_unpack.segmentation
from benchmarks.segmentation import ours
from benchmarks.segmentation.affinity_peers import AFFINITY_PEERS
from benchmarks.segmentation.bags import Case, cases
from benchmarks.segmentation.peers import PEERS
from benchmarks.segmentation.report import Scored, scored

KEPT = Path(tempfile.gettempdir()) / "napari-unpack-segmentation"
FINDERS = dict(PEERS) | AFFINITY_PEERS | ours.FINDERS


@dataclass(frozen=True)
class Task:
    """What is measured at once.

    Parameters
    ----------
    family : str
        See `bags.cases`.
    seed : int
        Of the volume.
    methods : tuple of str
        Names in `FINDERS`.
    """

    family: str
    seed: int
    methods: tuple[str, ...]


def measured(task: Task) -> list[tuple[str, Scored, bool]]:
    """Return the scores of every method, and whether they were kept from before.

    Raises
    ------
    FileNotFoundError
        If the volume is one that is not here.
    """
    found, case = [], None
    for method in task.methods:
        path = KEPT / f"{task.family}-{task.seed}-{method.replace(' ', '_')}-{_state(method)}.json"
        if path.exists():
            found.append((method, _read(path), True))
            continue
        case = case or next(cases(task.family, 1, task.seed))
        found.append((method, _scores(case, method), False))
        path.parent.mkdir(exist_ok=True)
        path.write_text(_text(found[-1][1]))
    return found


def _scores(case: Case, method: str) -> Scored:
    parts = list(_each(case, method))
    return Scored([t for p in parts for t in p.totals], pd.concat([p.objects for p in parts]))


def _each(case: Case, method: str) -> Iterator[Scored]:
    start = time.process_time()
    nothing = True
    for setting, labels in FINDERS[method](case.volume, case.spacing):
        nothing = False
        yield scored(method, setting, case, labels, time.process_time() - start)
        start = time.process_time()
    if nothing:
        yield Scored([], pd.DataFrame())


@cache
def _state(method: str) -> str:
    """Return a name of the state of all code and weights that a method's scores depend on."""
    # Once a process: an edit of the files changes nothing in one that runs.
    here, package = Path(__file__).parent, Path(napari_unpack.segmentation.__file__).parent
    paths = [here / "bags.py", here / "report.py", here / "peers.py"]
    if method in dict(PEERS):
        paths += [*(package / "foreground").glob("*.py"), package / "evaluation.py"]
    else:
        paths += [here / "ours.py", here / "affinity_peers.py"]
        paths += [p for p in package.rglob("*") if p.suffix in (".py", ".npz", ".onnx")]
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _text(found: Scored) -> str:
    table = found.objects.reset_index().to_csv(index=False) if len(found.objects) else ""
    return json.dumps({"totals": found.totals, "objects": table})


def _read(path: Path) -> Scored:
    kept = json.loads(path.read_text())
    if not kept["objects"]:
        return Scored(kept["totals"], pd.DataFrame())
    table = pd.read_csv(io.StringIO(kept["objects"]))
    return Scored(kept["totals"], table.set_index(table.columns[0]))
