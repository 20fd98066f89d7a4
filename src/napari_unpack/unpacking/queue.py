"""The queue of unpackable objects: section 5.4, immutable, so that undo is keeping the old one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from napari_unpack.geometry.axes import triple

Group = tuple[int, ...]


@dataclass(frozen=True)
class Queue:
    """Groups of objects in the order in which they will leave.

    Parameters
    ----------
    groups : tuple of tuple of int
        Most have one member; those with several leave together.
    direction : (3,) tuple of float, optional
        The D it was asked for, unit vector in world; None when it never was.
    restored : tuple of int
        Objects put back at the head, the next one first. They are no more than a wish until
        the queue is asked again: another object put back later may stand in front of them.
    least_occluded : bool
        True when no object was unpackable and the only entry is the least occluded object.
    packed : frozenset of int
        Who was in the bag when it was filled. Who comes in later may stand in front of others.
    rules : tuple
        The rules it was filled by, whatever they are.

    Notes
    -----
    Li et al. 2012, section 5.4: filled whenever the direction changes, taken from the head,
    restored objects return to the head. Deviation: restored objects are checked before they
    leave again (docs/paper.md, R9).
    """

    groups: tuple[Group, ...] = ()
    direction: tuple[float, float, float] | None = None
    restored: tuple[int, ...] = ()
    least_occluded: bool = False
    packed: frozenset[int] = frozenset()
    rules: tuple[object, ...] = ()

    @property
    def ids(self) -> tuple[int, ...]:
        """Every object in the queue, the next one first."""
        return tuple(i for group in self.groups for i in group)

    def serves(
        self, direction: Iterable[float], packed: Collection[int], rules: tuple[object, ...] = ()
    ) -> bool:
        """Tell whether the next one may leave without asking again.

        It must have been filled for this D and by these rules with all who are packed now in
        the bag, and hold something, all of it packed, and no restored object. The least occluded
        object is that only while all who were packed are.

        Parameters
        ----------
        direction : (3,) iterable of float
            D.
        packed : collection of int
            IDs in the bag now.
        rules : tuple
            What it must have been filled by.
        """
        if self.direction is None or not self.groups or self.restored or rules != self.rules:
            return False
        inside = frozenset(packed)
        if not (inside <= self.packed and inside.issuperset(self.ids)):
            return False
        # Who was taken for want of anything unpackable stays behind where something has become so.
        if self.least_occluded and inside != self.packed:
            return False
        return self.along(direction)

    def agrees(self, groups: Collection[Group]) -> bool:
        """Tell whether all of it is among what is known to leave now, sorted groups."""
        if self.least_occluded:
            return not groups
        return set(self.groups).issubset(groups)

    def along(self, direction: Iterable[float]) -> bool:
        """Tell whether it was filled for this D."""
        if self.direction is None:
            return False
        # D is a unit vector: 1e-6 is a ten-thousandth of a degree, well below a pixel.
        return bool(np.allclose(self.direction, tuple(direction), rtol=0.0, atol=1e-6))

    def without(self, ids: Iterable[int]) -> Queue:
        """Return the queue after objects have left or been hidden.

        Groups that lose a member are dropped whole: whether the others are still one group is
        for the next question to tell.
        """
        gone = set(ids)
        return replace(
            self,
            groups=tuple(group for group in self.groups if not gone.intersection(group)),
            restored=tuple(i for i in self.restored if i not in gone),
        )

    def put_back(self, ids: Iterable[int]) -> Queue:
        """Return the queue with restored objects at its head, the first given foremost."""
        new = tuple(ids)
        anew = set(new)
        # Restored again it moves to the head, and stands there once.
        rest = tuple(i for i in self.restored if i not in anew)
        return replace(self, restored=new + rest, least_occluded=False)

    def precedence(self, rank: Mapping[int, float]) -> Callable[[int], tuple[int, float, int]]:
        """Return the key by which objects leave: restored ones first, then by rank, ties by ID.

        A group leaves when its foremost member would.
        """
        place = {object_id: k for k, object_id in enumerate(self.restored)}
        return lambda i: (place.get(i, len(place)), rank.get(i, 0.0), i)

    def refilled(
        self,
        groups: Iterable[Group],
        direction: Iterable[float],
        packed: Iterable[int],
        rank: Mapping[int, float] | None = None,
        least_occluded: bool = False,
        rules: tuple[object, ...] = (),
    ) -> Queue:
        """Return the queue for a new answer.

        Parameters
        ----------
        groups : iterable of tuple of int
            All that can leave along the direction now.
        direction : (3,) iterable of float
            The D they were asked for.
        packed : iterable of int
            Who is in the bag now.
        rank : mapping of int to float, optional
            Smaller leaves earlier; a group counts as its foremost member. Without it, by ID.
        least_occluded : bool
            Whether this is the least occluded object for want of an unpackable one.
        rules : tuple
            The rules by which they are unpackable.

        Returns
        -------
        Queue
            Groups holding a restored object first, in the order of restoring; then by rank, ties
            by ID. Wishes that are not unpackable now are forgotten.
        """
        key = self.precedence(rank or {})
        whole = (tuple(sorted(group)) for group in groups)
        ready = tuple(sorted(whole, key=lambda group: min(map(key, group))))
        return Queue(ready, triple(direction), (), least_occluded, frozenset(packed), rules)
