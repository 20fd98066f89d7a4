"""How many answers a bag takes: a simulated person who knows the truth reviews doubts.

`python -m benchmarks.segmentation.review` takes two bags of each family. The person sees where
the two sides of a doubt meet, and answers by what most of each is there. Beside it, the same
person repairs by split and merge alone, always what is worth most: that takes no doubts, but
somebody who finds every fault, and three gestures for each command.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import edt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.segmentation.bags import Case, cases
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation import score, segment
from napari_unpack.segmentation.evaluation import Overlaps
from napari_unpack.segmentation.repair import (
    LabelEdit,
    edit_of_answer,
    merge_objects,
    split_between,
)
from napari_unpack.segmentation.review.doubts import Doubt, Said, doubts
from napari_unpack.segmentation.review.evidence import Evidence
from napari_unpack.segmentation.review.rescoring import SPREAD, odds

F1, VOI = 0.97, 0.10
# Voxels from the other side that a close-up shows.
NEAR = 12
MOST = 40

Labels = NDArray[np.int32]


@dataclass
class Reviewed:
    """How good labels were after so many answers."""

    marks: list[tuple[float, float]] = field(default_factory=list)
    changes: int = 0

    @property
    def needed(self) -> int | None:
        """Answers until both goals held; None where they never did."""
        good = [n for n, (f1, voi) in enumerate(self.marks) if f1 >= F1 and voi <= VOI]
        return good[0] if good else None

    def at(self, n: int) -> str:
        """Return F1 and VOI after so many answers, for the table."""
        return "{:.2f}, {:.2f}".format(*self.marks[min(n, len(self.marks) - 1)])


def marks_of(truth: NDArray[Any], labels: Labels) -> tuple[float, float]:
    """Return F1 and VOI."""
    found = score(truth, labels)
    return found["f1"], found["voi"]


def said_by(truth: NDArray[Any], labels: Labels, pieces: Labels, doubt: Doubt) -> Said:
    """Return what somebody who knows the truth says where the two sides meet.

    Parameters
    ----------
    truth, labels, pieces : (Z, Y, X) ndarray of int
    doubt : Doubt
    """
    one, two = doubt.objects
    there = np.isin(labels, [i for i in (one, two) if i])
    box = tuple(
        slice(int(a.min()), int(a.max()) + 1) for a in (np.flatnonzero(there.any(axis=tuple(
            k for k in range(3) if k != axis))) for axis in range(3))
    )  # fmt: skip
    part, own = labels[box], truth[box]
    if doubt.kind == "object":
        return "same" if _most(own[part == one]) else "nothing"
    side = part == one
    if doubt.kind == "join":
        side &= np.isin(pieces[box], doubt.side)
        rest = (part == one) & ~side
    else:
        rest = part == two
    near, beyond = (
        this & (edt.edt(~other, black_border=False) <= NEAR)
        for this, other in ((side, rest), (rest, side))
    )
    if not _most(own[side]):
        return "nothing"
    if _most(own[near]) != _most(own[beyond]):
        return "different"
    # One thing meets itself here, but to join two sides that hold others too would do harm.
    mixed = doubt.kind == "border" and _most(own[side]) != _most(own[rest])
    return "skip" if mixed else "same"


def _most(values: NDArray[Any]) -> int:
    return int(np.bincount(values).argmax()) if values.size else 0


def reviewed(truth: NDArray[Any], labels: Labels, evidence: Evidence, learn: bool) -> Reviewed:
    """Review until both goals hold, nothing is left, or 40 answers are given.

    Parameters
    ----------
    truth, labels : (Z, Y, X) ndarray of int
    evidence : Evidence
    learn : bool
        Whether answers re-score what is left.
    """
    found, answers, pieces = Reviewed([marks_of(truth, labels)]), [], evidence.pieces
    while found.needed is None and len(answers) < MOST:
        left = doubts(evidence, labels, answers, learn=learn)
        if not left:
            break
        doubt = left[0]
        said = said_by(truth, labels, pieces, doubt)
        answers.append(doubt.answered(said))
        edit = edit_of_answer(
            doubt, said, evidence, labels, label_boxes(labels), int(labels.max()) + 1
        )
        if edit is not None and len(edit.where):
            labels = edit.apply(labels)
            found.changes += 1
            found.marks.append(marks_of(truth, labels))
        else:
            found.marks.append(found.marks[-1])
    return found


def repaired(truth: NDArray[Any], labels: Labels, volume: NDArray[Any], spacing: Any) -> Reviewed:
    """Repair by split and merge alone, the largest fault first; see `reviewed`.

    Parameters
    ----------
    truth, labels : (Z, Y, X) ndarray of int
    volume : (Z, Y, X) ndarray
    spacing : (3,) sequence of float
    """
    found, tried = Reviewed([marks_of(truth, labels)]), set()
    while found.needed is None and len(found.marks) <= MOST:
        for key, edit in _repairs(truth, labels, volume, spacing, tried):
            tried.add(key)
            changed = edit.apply(labels)
            now = marks_of(truth, changed)
            # A cut that goes wrong is undone; it was a command all the same.
            if now[1] < found.marks[-1][1]:
                labels = changed
                found.marks.append(now)
                break
            found.marks.append(found.marks[-1])
            if len(found.marks) > MOST:
                break
        else:
            break
    return found


def _repairs(
    truth: NDArray[Any], labels: Labels, volume: NDArray[Any], spacing: Any, tried: set[Any]
) -> Iterator[tuple[Any, LabelEdit]]:
    """Yield repairs, that of the most voxels first."""
    shared, boxes = Overlaps.of(truth, labels), label_boxes(labels)
    table = shared.table
    wishes = []
    for f in range(1, table.shape[1]):
        order = np.argsort(-table[1:, f])
        for second in order[1:3].tolist():
            wishes.append((int(table[1 + second, f]), "split", f, int(order[0]) + 1, second + 1))
    for t in range(1, table.shape[0]):
        order = np.argsort(-table[t, 1:]) + 1
        for second in order[1:4].tolist():
            # What is mostly another thing's is not merged.
            if table[1:, second].argmax() + 1 == t and table[1:, order[0]].argmax() + 1 == t:
                wishes.append((int(table[t, second]), "merge", int(order[0]), second, 0))
    for voxels, verb, a, b, c in sorted(wishes, reverse=True):
        if voxels < 100:
            return
        ids = shared.found_ids
        if verb == "merge":
            pair = int(ids[a]), int(ids[b])
            key: Any = (verb, *pair, int(boxes.counts[boxes.index(pair[0])]))
            if key not in tried:
                yield key, merge_objects(labels, boxes, pair)
            continue
        name, first, second = int(ids[a]), int(shared.true_ids[b]), int(shared.true_ids[c])
        key = (verb, name, first, second, int(boxes.counts[boxes.index(name)]))
        if key not in tried:
            ends = [_middle((labels == name) & (truth == t)) for t in (first, second)]
            top = int(labels.max()) + 1
            yield key, split_between(labels, boxes, volume, spacing, ends[0], ends[1], top)


def _middle(mask: NDArray[np.bool_]) -> tuple[int, int, int]:
    depth = edt.edt(mask, black_border=True)
    z, y, x = (int(v) for v in np.unravel_index(int(depth.argmax()), mask.shape))
    return z, y, x


def examples(case: Case) -> list[tuple[Doubt, bool]]:
    """Return every decision behind a bag's labels, and whether both sides are one object."""
    made = segment(case.volume, case.spacing)
    assert made.evidence is not None
    pieces, found = made.evidence.pieces, doubts(made.evidence, made.labels, least=0.0, share=2.0)
    said = [said_by(case.labels, made.labels, pieces, doubt) for doubt in found]
    return [(doubt, word == "same") for doubt, word in zip(found, said, strict=True)]


def fitted(rows: list[tuple[Doubt, bool]], restraint: float = 4.0) -> NDArray[np.float64]:
    """Return how far the method's odds are believed, and the weights before any answer.

    Parameters
    ----------
    rows : list of (Doubt, bool)
    restraint : float
        Of the weights' squares; chosen by leaving one bag out.
    """
    base = odds(np.array([doubt.shipped for doubt, _ in rows]))
    known = np.array([doubt.row for doubt, _ in rows]) / SPREAD
    same = np.array([same for _, same in rows])

    def loss(p: NDArray[np.float64]) -> float:
        total = p[0] * base + known @ p[1:]
        kept = (p[1:] ** 2).sum() + 4 * (p[0] - 1) ** 2
        return float((np.logaddexp(0, total) - same * total).sum() + restraint * kept / 2)

    return np.asarray(minimize(loss, np.zeros(1 + len(SPREAD)), method="L-BFGS-B").x.round(2))


COLUMNS = ("bag", "objects", "before", "after 5", "after 15", "after 40 or all", "answers needed")


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.segmentation.review")
    parser.add_argument("families", nargs="*", default=["first", "second"])
    parser.add_argument("--count", type=int, default=2, help="bags of each family")
    parser.add_argument("--first", type=int, default=9401, help="seed of the first bag")
    parser.add_argument("--fit", action="store_true", help="fit the weights before any answer")
    options = parser.parse_args(arguments)
    if options.fit:
        bags = [c for f in options.families for c in cases(f, options.count, options.first)]
        print(fitted([row for case in bags for row in examples(case)]))
        return 0
    print("F1 and VOI.\n\n| " + " | ".join(("way", *COLUMNS)) + " |")
    print("|---" * (len(COLUMNS) + 1) + "|")
    for family in options.families:
        for case in cases(family, options.count, options.first):
            made = segment(case.volume, case.spacing)
            for line in rows(case, made.labels, made.evidence):
                print(line, flush=True)
    return 0


def rows(case: Case, labels: Labels, evidence: Evidence) -> Iterator[str]:
    """Yield the table's rows of one bag."""
    ways = {
        "review": lambda: reviewed(case.labels, labels, evidence, True),
        "review, nothing learned": lambda: reviewed(case.labels, labels, evidence, False),
        "split and merge": lambda: repaired(case.labels, labels, case.volume, case.spacing),
    }
    for name, way in ways.items():
        found = way()
        needed = "not reached" if found.needed is None else str(found.needed)
        cells = [case.name, str(len(np.unique(case.labels)) - 1), found.at(0), found.at(5)]
        yield "| " + " | ".join([name, *cells, found.at(15), found.at(MOST), needed]) + " |"


if __name__ == "__main__":
    raise SystemExit(main())
