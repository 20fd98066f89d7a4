"""What a step of segmentation joined, and how sure it was: the ground of a person's review."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.common.merging import root, roots

# Joins from this probability on are not worth a question: what they join becomes one piece.
SURE = 0.97


@dataclass(eq=False)
class JoinLog:
    """Joins in the order in which they were made, and the pairs left apart.

    Parameters
    ----------
    joined : list of (int, int, float)
        The name that stays, the name that goes, and the probability that both are one object.
    apart : dict of (int, int) to float
        The same probability of pairs, the smaller name first, that were never joined; also of
        names that are gone by the end.
    """

    joined: list[tuple[int, int, float]] = field(default_factory=list)
    apart: dict[tuple[int, int], float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Level:
    """One step's parts as they were before it joined them.

    Parameters
    ----------
    names : (Z, Y, X) ndarray of int32
        Parts 1, 2, ...; 0 is none.
    joined : sequence of (int, int, float)
        As in `JoinLog`.
    apart : mapping of (int, int) to float
        Of parts that stand for what was joined to them; the smaller first.
    """

    names: NDArray[np.int32]
    joined: Sequence[tuple[int, int, float]]
    apart: Mapping[tuple[int, int], float]

    @staticmethod
    def of(
        log: JoinLog, names: NDArray[np.int32], pairs: NDArray[np.int64], area: NDArray[np.float64]
    ) -> Level:
        """Return a step whose sure joins are made already, so that few parts are left.

        Parameters
        ----------
        log : JoinLog
        names : (Z, Y, X) ndarray of int32
        pairs : (N, 2) ndarray of int64
            Parts that touch.
        area : (N,) ndarray of float64
            How much.
        """
        count = int(max(names.max(initial=0), pairs.max(initial=0))) + 1
        joint = joint_of(log.joined, pairs)
        owner, left = np.arange(count), []
        best = strongest(joint, area, len(log.joined))
        for (_, _, chance), k in zip(log.joined, best.tolist(), strict=True):
            if k < 0:
                continue
            if chance >= SURE:
                one, two = (root(owner, int(n)) for n in pairs[k])
                owner[max(one, two)] = min(one, two)
            else:
                left.append((k, chance))
        owner = roots(owner)
        # What is left are edges of a tree: each joins two clusters, named by one part of them.
        cluster, joined = np.arange(count), []
        for k, chance in left:
            one, two = (root(cluster, int(owner[n])) for n in pairs[k])
            if one != two:
                cluster[two] = one
                joined.append((one, two, chance))
        final = np.arange(count)
        for one, two, _ in log.joined:
            final[two] = one
        apart: dict[tuple[int, int], float] = {}
        for (a, b), chance in log.apart.items():
            # Names that are gone were judged again by those that took them in.
            if final[a] == a and final[b] == b:
                one, two = sorted(root(cluster, int(owner[n])) for n in (a, b))
                apart[one, two] = chance
        return Level(owner.astype(np.int32)[names], joined, apart)


@dataclass(frozen=True, eq=False)
class Seen:
    """What a method looked at.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    scale : DensityScale
        How densities were compared.
    matter : (Z, Y, X) ndarray of uint8
        How probable it is that a voxel is an object's, 255 for sure.
    """

    density: NDArray[np.generic]
    scale: DensityScale
    matter: NDArray[np.uint8]


@dataclass(eq=False)
class Steps:
    """What a method noted on its way to the labels.

    Parameters
    ----------
    levels : list of Level
        The first step first.
    seen : Seen, optional
    """

    levels: list[Level] = field(default_factory=list)
    seen: Seen | None = None


def joint_of(
    joined: Sequence[tuple[int, int, float]], pairs: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the number of the join by which the two of each pair came together, -1 for none.

    Parameters
    ----------
    joined : sequence of (int, int, float)
    pairs : (N, 2) ndarray of int64
    """
    found = np.full(len(pairs), -1)
    waiting: dict[int, set[int]] = {}
    for k, (one, two) in enumerate(pairs.tolist()):
        if one != two:
            waiting.setdefault(one, set()).add(k)
            waiting.setdefault(two, set()).add(k)
    for n, (one, two, _) in enumerate(joined):
        mine, theirs = waiting.pop(one, set()), waiting.pop(two, set())
        met = mine & theirs
        found[list(met)] = n
        waiting[one] = (mine | theirs) - met
    return found


def strongest(joint: NDArray[np.int64], area: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return for each of `count` joins the pair that touches most, -1 where none does.

    Parameters
    ----------
    joint : (N,) ndarray of int64
        See `joint_of`.
    area : (N,) ndarray of float64
    count : int
    """
    best = np.full(count, -1)
    order = np.argsort(area, kind="stable")
    order = order[(joint[order] >= 0) & (area[order] > 0)]
    # The last one written is the largest.
    best[joint[order]] = order
    return best
