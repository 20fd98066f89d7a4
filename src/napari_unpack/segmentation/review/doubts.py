"""Doubts: decisions behind the labels that may be wrong, the one that would change most first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from napari_unpack.segmentation.review.evidence import Evidence
from napari_unpack.segmentation.review.rescoring import FEATURES, Rescoring

Kind = Literal["join", "border", "object"]
Said = Literal["same", "different", "nothing", "skip"]
SAID: tuple[Said, ...] = ("same", "different", "nothing", "skip")
# What was measured, of a doubt or of an answer.
Row: TypeAlias = NDArray[np.float64] | tuple[float, ...]

# Decisions less likely to be wrong are not asked about.
LEAST_DOUBT = 0.05
# Of what answers may win, all told: the many doubts that share the rest are not worth the time.
# What was asked counts too, or each answer would bring up more of them.
SHARE = 0.9
# Flows are of whole numbers: so many to a face that is sure to be within one object.
BOND_STEPS = 100
# A person's word: more than all faces of a bag, and some hundred of them fit 32 bits.
MOST_BOND = 20_000_000


@dataclass(frozen=True)
class Answer:
    """What a person said of a decision.

    Parameters
    ----------
    kind : {"join", "border", "object"}
    pieces : (int, int)
        Of the evidence, by which the decision is known; the second is 0 for an object.
    said : {"same", "different", "nothing", "skip"}
        Whether both sides are one object, or the first side is no object at all.
    chance : float
        Probability that both are one object, as the method had it.
    row : tuple of float
        What was measured, in the order of `rescoring.FEATURES`.
    """

    kind: Kind
    pieces: tuple[int, int]
    said: Said
    chance: float
    row: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Doubt:
    """A decision that may be wrong.

    Parameters
    ----------
    kind : {"join", "border", "object"}
        Two sides joined to one object, two objects left apart, or one object that may be none.
    pieces : (int, int)
        See `Answer`.
    objects : (int, int)
        Of the two sides; the same for a join, the second 0 for an object.
    side : (K,) ndarray of int64
        The pieces of the first side, which has fewer voxels.
    chance : float
        Probability that both are one object (or that it is one), by the answers so far.
    shipped : float
        The same before any answer.
    worth : float
        Bits by which labels would be better, times how likely they are wrong.
    row : (F,) ndarray of float64
    revision : int, optional
        Of the labels it was asked of, where a session asked.
    """

    kind: Kind
    pieces: tuple[int, int]
    objects: tuple[int, int]
    side: NDArray[np.int64]
    chance: float
    shipped: float
    worth: float
    row: NDArray[np.float64]
    revision: int | None = None

    @property
    def doubt(self) -> float:
        """How likely the decision is wrong."""
        return _doubt(self.kind, self.chance)

    def changed_by(self, said: Said) -> bool:
        """Return whether an answer changes the labels."""
        return said == "nothing" or (self.kind, said) in (("border", "same"), ("join", "different"))

    def answered(self, said: Said) -> Answer:
        """Return the record of an answer to it."""
        row = tuple(float(v) for v in self.row)
        return Answer(self.kind, self.pieces, said, self.shipped, row)


def doubts(
    evidence: Evidence,
    labels: NDArray[np.integer[Any]],
    answers: Sequence[Answer] = (),
    least: float = LEAST_DOUBT,
    share: float = SHARE,
    learn: bool = True,
) -> list[Doubt]:
    """Return what is left to review, the most worthwhile first.

    Parameters
    ----------
    evidence : Evidence
    labels : (Z, Y, X) ndarray of int
        As they are now, whoever changed them.
    answers : sequence of Answer
        Given so far.
    least : float
        How likely a decision is wrong that is asked about.
    share : float
        Of what all are worth, those answered too: as many of the first as have so much are asked.
    learn : bool
        Whether answers re-score what is left.
    """
    objects = objects_of(evidence, labels)
    found = [*_joins(evidence, objects, answers), *_borders(evidence, objects, answers)]
    found += _specks(evidence, objects, answers)
    if not found:
        return []
    taught = [a for a in answers if learn and _says_something(a)]
    model = Rescoring.of(
        np.array([a.row for a in taught]),
        np.array([a.said == "same" for a in taught]),
        np.array([a.chance for a in taught]),
    )
    total = float(evidence.sums[:, 0].sum())
    chances = _chances(model, [d.row for d in found], [d.shipped for d in found])
    made = [
        replace(d, chance=c, worth=_worth(d.kind, d.row, c, total))
        for d, c in zip(found, chances, strict=True)
    ]
    made = sorted((d for d in made if d.doubt >= least), key=lambda d: (-d.worth, d.pieces))
    chances = _chances(model, [a.row for a in answers], [a.chance for a in answers])
    asked = [_worth(a.kind, a.row, c, total) for a, c in zip(answers, chances, strict=True)]
    before = np.cumsum([0.0, *asked, *(d.worth for d in made)])
    left = zip(made, before[len(asked) :], strict=False)
    return [d for d, sum_before in left if sum_before < share * before[-1]]


def still_asked(doubt: Doubt, evidence: Evidence, labels: NDArray[np.integer[Any]]) -> bool:
    """Return whether both sides of a doubt are what they were when it was found.

    Parameters
    ----------
    doubt : Doubt
    evidence : Evidence
    labels : (Z, Y, X) ndarray of int
        As they are now.
    """
    objects, one = objects_of(evidence, labels), doubt.objects[0]
    ends = sorted(objects[list(doubt.pieces)].tolist())
    if doubt.kind == "join":
        # The rest of the object may have grown or shrunk.
        return ends == [one, one] and bool((objects[doubt.side] == one).all())
    same = np.array_equal(np.flatnonzero(objects == one), doubt.side)
    return same and ends == sorted(doubt.objects)


def _says_something(answer: Answer) -> bool:
    """Return whether an answer says if both sides are one object, or if the one side is one."""
    # Of two sides, one that is no object says nothing of how objects meet.
    return answer.said in ("same", "different") or (answer.kind, answer.said) == (
        "object",
        "nothing",
    )


def objects_of(evidence: Evidence, labels: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return the object that most of each piece belongs to now, (M,).

    Parameters
    ----------
    evidence : Evidence
    labels : (Z, Y, X) ndarray of int
    """
    pieces = evidence.pieces
    inside = pieces > 0
    top = int(labels.max(initial=0)) + 1
    keys, counts = np.unique(
        pieces[inside].astype(np.int64) * top + labels[inside], return_counts=True
    )
    owner = np.zeros(len(evidence.sums), np.int64)
    order = np.argsort(counts, kind="stable")
    # The last one written is the most frequent.
    owner[keys[order] // top] = keys[order] % top
    return owner


def _joins(
    evidence: Evidence, objects: NDArray[np.int64], answers: Sequence[Answer]
) -> list[Doubt]:
    """Return every join that holds an object together, with the side that it would lose."""
    ends = objects[evidence.pairs]
    held = (ends[:, 0] == ends[:, 1]) & (ends[:, 0] > 0)
    known = {a.pieces for a in answers}
    one_object = {a.pieces for a in answers if a.said == "same"}
    said = np.array([tuple(p) in one_object for p in evidence.pairs.tolist()], np.bool_)
    # Nothing that was measured tears apart what a person called one object.
    strength = np.where(said, np.inf, evidence.contact[:, 0] * evidence.chance)
    found = []
    for object_id in np.unique(ends[held, 0]).tolist():
        inner = np.flatnonzero(held & (ends[:, 0] == object_id))
        members, flat = np.unique(evidence.pairs[inner], return_inverse=True)
        places = flat.reshape(-1, 2)
        bonds = _bonds(strength[inner], places, len(members))
        for k, (here, there) in zip(inner.tolist(), places.tolist(), strict=True):
            one, two = (int(n) for n in evidence.pairs[k])
            if not evidence.tree[k] or (one, two) in known:
                continue
            mask = _torn_off(bonds, here, there)
            if (mask[places[said[inner], 0]] != mask[places[said[inner], 1]]).any():
                continue
            side, rest = members[mask], members[~mask]
            if evidence.sums[side, 0].sum() >= evidence.sums[rest, 0].sum():
                side, rest = rest, side
            row, chance = _measured(evidence, "join", side, rest), float(evidence.chance[k])
            names = (object_id, object_id)
            found.append(Doubt("join", (one, two), names, side, chance, chance, 0.0, row))
    return found


def _bonds(strength: NDArray[np.float64], places: NDArray[np.intp], count: int) -> csr_array:
    """Return how strongly pieces hold on to each other, both ways, in whole numbers."""
    # Both ways add up in a flow, and many meet at one piece.
    whole = np.clip(strength * BOND_STEPS, 1, MOST_BOND).astype(np.int32)
    one, two = places.T
    both = (np.concatenate([one, two]), np.concatenate([two, one]))
    return csr_array((np.concatenate([whole, whole]), both), (count, count))


def _torn_off(bonds: csr_array, one: int, two: int) -> NDArray[np.bool_]:
    """Return which pieces stay with the first of two that are torn apart where least holds them.

    Parameters
    ----------
    bonds : (N, N) csr_array of int32
    one, two : int

    Notes
    -----
    A minimum cut. Cutting the asked join of the tree alone would leave with the second piece all
    that had been joined to it later, whatever holds it to the first.
    """
    left = csr_array(bonds - maximum_flow(bonds, one, two).flow)
    left.eliminate_zeros()
    reached = np.zeros(bonds.shape[0], np.bool_)
    reached[breadth_first_order(left, one, return_predecessors=False)] = True
    return reached


def _borders(
    evidence: Evidence, objects: NDArray[np.int64], answers: Sequence[Answer]
) -> list[Doubt]:
    """Return every two objects that touch, unless a person parted them."""
    ends = np.sort(objects[evidence.pairs], axis=1)
    apart = np.flatnonzero((ends[:, 0] != ends[:, 1]) & (ends[:, 0] > 0))
    settled = {tuple(sorted(objects[list(a.pieces)].tolist())) for a in answers if a.pieces[1]}
    area = evidence.contact[:, 0]
    found = []
    couples, place = np.unique(ends[apart], axis=0, return_inverse=True)
    for n, couple in enumerate(couples.tolist()):
        if tuple(couple) in settled:
            continue
        rows = apart[place.reshape(-1) == n]
        chance = float(np.average(evidence.chance[rows], weights=area[rows]))
        most = rows[area[rows].argmax()]
        sides = [np.flatnonzero(objects == i) for i in couple]
        small, large = sorted(sides, key=lambda side: float(evidence.sums[side, 0].sum()))
        one, two = (int(p) for p in evidence.pairs[most])
        row = _measured(evidence, "border", small, large)
        names = int(objects[small[0]]), int(objects[large[0]])
        found.append(Doubt("border", (one, two), names, small, chance, chance, 0.0, row))
    return found


def _specks(
    evidence: Evidence, objects: NDArray[np.int64], answers: Sequence[Answer]
) -> list[Doubt]:
    """Return every object with how probable it is one."""
    known = {int(objects[a.pieces[0]]) for a in answers if a.kind == "object"}
    found = []
    for object_id in np.unique(objects[objects > 0]).tolist():
        if object_id in known:
            continue
        side = np.flatnonzero(objects == object_id)
        sums = evidence.sums[side].sum(axis=0)
        chance = float(sums[3] / sums[0])
        most = int(side[evidence.sums[side, 0].argmax()])
        row = _measured(evidence, "object", side, side[:0])
        found.append(Doubt("object", (most, 0), (object_id, 0), side, chance, chance, 0.0, row))
    return found


def _measured(
    evidence: Evidence, kind: Kind, side: NDArray[np.int64], rest: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return what tells how two sides meet, in the order of `rescoring.FEATURES`."""
    small, large = evidence.sums[side].sum(axis=0), evidence.sums[rest].sum(axis=0)
    row = np.zeros(len(FEATURES))
    row[("join", "border", "object").index(kind)] = 1.0
    row[3] = np.log10(small[0] / 1000)
    mean = small[1] / small[0]
    if not len(rest):
        row[9:] = mean, small[4] / small[0]
        return row
    inside, beyond = (np.isin(evidence.pairs, which) for which in (side, rest))
    across = (inside[:, 0] & beyond[:, 1]) | (inside[:, 1] & beyond[:, 0])
    touching = (inside[:, 0] != inside[:, 1]).astype(float) @ evidence.contact[:, 0] + small[4]
    contact = evidence.contact[across].sum(axis=0)
    faces = max(float(contact[0]), 1.0)
    other = large[1] / large[0]
    row[4:9] = (
        np.log10(large[0] / small[0]),
        contact[0] / max(touching, 1.0),
        abs(mean - other),
        contact[2] / faces,
        min(mean, other) - contact[1] / faces,
    )
    row[9] = max(mean, other)
    return row


def _chances(model: Rescoring, rows: Sequence[Row], shipped: Sequence[float]) -> list[float]:
    """Return the probabilities that both sides are one object, by the answers so far."""
    known = np.array(rows, np.float64).reshape(-1, len(FEATURES))
    return [float(c) for c in model.chances(known, np.array(shipped))]


def _doubt(kind: Kind, chance: float) -> float:
    """Return how likely a decision is wrong."""
    return chance if kind == "border" else 1 - chance


def _worth(kind: Kind, row: Row, chance: float, total: float) -> float:
    """Return what a decision is worth, of all objects' voxels together; see `Doubt`."""
    wrong, small = _doubt(kind, chance), 1000 * 10 ** float(row[3])
    if kind == "object":
        return wrong * small / total
    large = small * 10 ** float(row[4])
    both = small + large
    bits = small * np.log2(both / small) + large * np.log2(both / large)
    return wrong * float(bits) / total
