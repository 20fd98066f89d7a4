"""Packing a bag: what goes in, in which order, and where each thing comes to rest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation.blueprint import Blueprint, Rotation
from napari_unpack.simulation.clay import turned
from napari_unpack.simulation.draping import Cloth, Draped, drape, tailor
from napari_unpack.simulation.nesting import Content, contents, room_of
from napari_unpack.simulation.nestling import WALL, nestle, surface, walled
from napari_unpack.simulation.planning import Order
from napari_unpack.simulation.rasterizing import Raster, rasterize, silhouette, silhouette_size
from napari_unpack.simulation.stacking import Profile, Rest, Stack

SHRINK = 0.9
"""A thing that finds no place is tried again at this share of its length..."""

SMALLEST = 0.35
"""...until this share is left: a third of a shoe is a toy's, less is nothing a person packs."""

CONTENT_SHARES = (1.0, 0.8, 0.64, 0.51)
"""The same for what lies in a container, in coarser steps: there are few turns to try."""

FEWEST_VOXELS = 6
"""Below this a thing is noise to any segmentation, and its truth would say nothing."""


@dataclass(frozen=True)
class Record:
    """What the table of objects says of one.

    Parameters
    ----------
    kind, name, material : str
        See `Blueprint`.
    parent : int
        ID of the object that it lies in, 0 for none.
    mass_g : float
        Mass, g.
    """

    kind: str
    name: str
    material: str
    parent: int
    mass_g: float


@dataclass(eq=False)
class Packing:
    """A bag being packed.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        IDs from 1 in the order of packing; `WALL` outside the room until `opened`.
    density : (Z, Y, X) ndarray of float32
        CT number + 1000, before the scanner.
    stack : Stack
        The room that is left.
    spacing : (3,) ndarray of float64, mm z y x
    """

    labels: NDArray[np.uint16]
    density: NDArray[np.float32]
    stack: Stack
    spacing: NDArray[np.float64]
    records: list[Record] = field(default_factory=list)

    @classmethod
    def empty(
        cls, shape: tuple[int, int, int], room: Stack, spacing: NDArray[np.float64]
    ) -> Packing:
        """Return an empty bag of a given room.

        Parameters
        ----------
        shape : (int, int, int)
            Of the volume, z y x.
        room : Stack
            The inside of the bag.
        spacing : (3,) ndarray of float64, mm z y x
        """
        labels = np.zeros(shape, np.uint16)
        walled(labels, room)
        return cls(labels, np.zeros(shape, np.float32), room, spacing)

    def opened(self) -> NDArray[np.uint16]:
        """Return the labels, 0 where there are no objects; nothing can be packed after."""
        self.labels[self.labels == WALL] = 0
        return self.labels

    @property
    def wall(self) -> float:
        """Thinnest wall that is resolved, mm."""
        # Thinner than 1.6 voxels a wall breaks into holes on the grid.
        return 1.6 * float(np.prod(self.spacing)) ** (1 / 3)

    def add(self, order: Order, rng: np.random.Generator) -> bool:
        """Place one ordered thing and what it holds, smaller where it does not fit.

        Parameters
        ----------
        order : Order
            What to place.
        rng : numpy.random.Generator
            Chooses the places to try.

        Returns
        -------
        bool
            Whether it found a place.
        """
        share = 1.0
        while share > SMALLEST:
            smaller = replace(order, length=order.length * share)
            if order.kind.build is None:
                placed = self._drape(smaller, rng)
            else:
                placed = self._drop(smaller, rng)
            if placed:
                return True
            # Smaller until it fits: a count that was asked for matters more than a size.
            share *= SHRINK
        return False

    def _drape(self, order: Order, rng: np.random.Generator) -> bool:
        own = np.random.default_rng(order.seed)
        cloth = tailor(own, order.kind.name, order.length, self.wall)
        laid = drape(rng, cloth, self.stack, self.spacing)
        if laid is None or laid.inside.sum() < FEWEST_VOXELS:
            return False
        # Its place is decided already; the cost is not looked at.
        rest = Rest(*laid.corner, cost=0.0)
        # Both must know of it: `nestle` reads the labels, the next search the stack.
        self._put(cloth, laid, rest)
        self.stack.load(Profile.of(laid.inside), rest)
        return True

    def _drop(self, order: Order, rng: np.random.Generator) -> bool:
        assert order.kind.build is not None
        # Its own generator: at a smaller size it is the same thing, whatever was tried before.
        own = np.random.default_rng(order.seed)
        thing = order.kind.build(own, order.length, self.wall)
        # Every way tried costs a raster of the whole thing, so only the two best are.
        for rotation, spot in self._spots(thing, rng)[:2]:
            raster = rasterize(thing.clay, rotation, self.spacing)
            profile = Profile.of(raster.inside)
            if raster.inside.sum() < FEWEST_VOXELS:
                return False
            pool = _pool(self.labels.shape)
            rest = self.stack.near(profile, spot.z * pool, spot.x * pool, pool + 1)
            if rest is None:
                continue
            # Neither lifts it, and neither lets it into another thing.
            rest = self.stack.settle(profile, rest)
            rest = nestle(self.labels, surface(raster.inside), rest)
            self.stack.load(profile, rest)
            self._put(thing, raster, rest)
            if order.inside and thing.room is not None:
                self._fill(thing, rotation, raster, rest, order.inside, own)
            return True
        return False

    def _fill(
        self,
        container: Blueprint,
        rotation: Rotation,
        raster: Raster,
        rest: Rest,
        count: int,
        rng: np.random.Generator,
    ) -> None:
        parent = len(self.records)
        room = room_of(container, rotation, raster.inside.shape, raster.origin, self.spacing)
        for content in contents(rng, container, count):
            found = self._nook(content, room, rng)
            if found is None:
                continue
            thing, part, spot = found
            room.load(Profile.of(part.inside), spot)
            place = Rest(rest.z + spot.z, rest.y + spot.y, rest.x + spot.x, 0.0)
            self._put(thing, part, place, parent)

    def _nook(
        self, content: Content, room: Stack, rng: np.random.Generator
    ) -> tuple[Blueprint, Raster, Rest] | None:
        # The best of a few turns, at the first size that fits.
        for share in CONTENT_SHARES:
            thing = content.model(share, self.wall)
            found = []
            for degrees in rng.uniform(0, 360, 3):
                # At rest as usual, turned about the vertical alone: the room is low.
                turn = turned("y", float(degrees)) @ thing.rests[0]
                part = rasterize(thing.clay, turn, self.spacing)
                spot = room.best(Profile.of(part.inside))
                if spot is not None and part.inside.sum() >= FEWEST_VOXELS:
                    found.append((thing, part, spot))
            if found:
                return min(found, key=lambda each: each[2].cost)
        return None

    def _spots(self, thing: Blueprint, rng: np.random.Generator) -> list[tuple[Rotation, Rest]]:
        # Coarse resting places, one for each way of lying, the best first.
        pool = _pool(self.labels.shape)
        stack = self.stack.coarse(pool)
        room = stack.height.shape
        found = []
        for rotation in _ways_to_lie(thing, rng):
            # Voxels of a very different length along one axis make silhouettes of many rows.
            if (silhouette_size(thing.clay, rotation, self.spacing, pool)[::2] > room).any():
                continue
            profile = silhouette(thing.clay, rotation, self.spacing, pool)
            spot = stack.best(profile)
            if spot is not None:
                found.append((rotation, spot))
        return sorted(found, key=lambda pair: pair[1].cost)

    def _put(
        self, thing: Blueprint | Cloth, part: Raster | Draped, rest: Rest, parent: int = 0
    ) -> None:
        # The box of a raster is a voxel wider than the thing, and may stick out of the volume.
        first = np.array([rest.z, rest.y, rest.x])
        low = np.maximum(first, 0)
        high = np.minimum(first + part.inside.shape, self.labels.shape)
        target = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        source = tuple(slice(a, b) for a, b in zip(low - first, high - first, strict=True))
        self.records.append(Record(thing.kind, thing.name, thing.material, parent, part.grams))
        self.labels[target][part.inside[source]] = len(self.records)
        self.density[target] += part.density[source]


def _pool(shape: tuple[int, ...]) -> int:
    """Return how many voxels a column of the coarse search is wide."""
    # Some 45 columns across: fine enough for small things, quick for the search of all places.
    return int(np.clip(round(min(shape) / 45), 1, 6))


def _ways_to_lie(thing: Blueprint, rng: np.random.Generator) -> list[Rotation]:
    """Return the rotations to try: each way of resting, turned about the vertical."""
    ways = []
    for index, rest in enumerate(thing.rests):
        # The first way of resting is the usual one, and gets all four quarters.
        quarters = rng.permutation(4)[: 4 if index == 0 else 2]
        for quarter in quarters:
            if thing.square:
                ways.append(turned("y", 90.0 * quarter) @ rest)
                continue
            # Nobody packs to the degree: 14 about the vertical, 9 as a tilt on what lies below.
            yaw = 90.0 * quarter + rng.normal(0.0, 14.0)
            ways.append(turned("y", float(yaw)) @ rest)
            tilt = turned("z", float(rng.normal(0, 9.0))) @ turned("x", float(rng.normal(0, 9.0)))
            ways.append(turned("y", float(yaw)) @ tilt @ rest)
    return ways
