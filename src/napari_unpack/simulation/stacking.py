"""Dropping things: a height field of what lies in the bag, and where a thing comes to rest on it.

What falls straight down meets only the uppermost matter of each column, so the height field
decides exactly, and nothing can overlap. Rows are whole voxels; heights are rows, growing down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

Field = NDArray[np.int32]
BLOCKED = -(1 << 20)
"""A height above every bag: nothing fits under it, and sums of it stay within int32."""


@dataclass(frozen=True, eq=False)
class Profile:
    """What a thing looks like from below and from above.

    Parameters
    ----------
    under : (Z, X) ndarray of int32
        Row below its lowest voxel in each column of its box, BLOCKED where it has none.
    over : (Z, X) ndarray of int32
        Row of its highest voxel.
    """

    under: Field
    over: Field

    @classmethod
    def of(cls, inside: NDArray[np.bool_]) -> Profile:
        """Return the profile of a thing's voxels, (Z, Y, X)."""
        used = inside.any(axis=1)
        over = inside.argmax(axis=1)
        under = inside.shape[1] - inside[:, ::-1].argmax(axis=1)
        return cls(
            np.where(used, under, BLOCKED).astype(np.int32),
            np.where(used, over, 0).astype(np.int32),
        )


@dataclass(frozen=True)
class Rest:
    """A resting place.

    Parameters
    ----------
    z, y, x : int
        First voxel of the thing's box.
    cost : float
        Rows; the place that costs least is taken.
    """

    z: int
    y: int
    x: int
    cost: float


@dataclass(eq=False)
class Stack:
    """The room that is left, by column.

    Parameters
    ----------
    height : (Z, X) ndarray of int32
        First row that is taken, counted from above; BLOCKED where nothing may enter.
    ceiling : (Z, X) ndarray of int32
        First free row under the lid.
    """

    height: Field
    ceiling: Field

    def coarse(self, pool: int) -> Stack:
        """Return the same room in columns of pool x pool, never larger than it is."""
        z, x = self.height.shape
        pad = ((0, -z % pool), (0, -x % pool))

        def blocks(field: Field, fill: int) -> NDArray[np.int32]:
            padded = np.pad(field, pad, constant_values=fill)
            return padded.reshape(padded.shape[0] // pool, pool, padded.shape[1] // pool, pool)

        low = blocks(self.height, BLOCKED).min(axis=(1, 3))
        # The least room of a block on both sides: what fits coarsely fits finely.
        lid = blocks(self.ceiling, 1 << 20).max(axis=(1, 3))
        return Stack(np.ascontiguousarray(low), np.ascontiguousarray(lid))

    def best(self, profile: Profile) -> Rest | None:
        """Return the lowest, fullest resting place of all, or None where it fits nowhere."""
        # A reach as long as the room is wide leaves no place out.
        return self.near(profile, 0, 0, max(self.height.shape))

    def near(self, profile: Profile, z: int, x: int, reach: int) -> Rest | None:
        """Return the best resting place within `reach` columns of (z, x).

        Parameters
        ----------
        profile : Profile
        z, x, reach : int
            Columns.
        """
        a, b, c, cost = _search(
            self.height, self.ceiling, profile.under, profile.over,
            max(z - reach, 0), z + reach + 1, max(x - reach, 0), x + reach + 1,
        )  # fmt: skip
        return None if a < 0 else Rest(a, b, c, cost)

    def settle(self, profile: Profile, rest: Rest) -> Rest:
        """Let a thing slide, column by column, as long as that brings it lower.

        Parameters
        ----------
        profile : Profile
        rest : Rest
            Where it begins.
        """
        # The coarse search left it within a few columns of the best place.
        for _ in range(24):
            lower = self.near(profile, rest.z, rest.x, 1)
            # Rounding must not let it slide for ever between two equal places.
            if lower is None or lower.cost >= rest.cost - 1e-6:
                return rest
            rest = lower
        return rest

    def load(self, profile: Profile, rest: Rest) -> None:
        """Raise the stack by what has come to rest on it.

        Parameters
        ----------
        profile : Profile
        rest : Rest
            Where it lies.
        """
        z, x = profile.under.shape
        window = self.height[rest.z : rest.z + z, rest.x : rest.x + x]
        # Columns of its box that a thing leaves empty stay open to others.
        used = profile.under > BLOCKED
        window[used] = np.minimum(window[used], rest.y + profile.over[used])


@njit(cache=True, nogil=True)
def _search(height, ceiling, under, over, z0, z1, x0, x1):  # type: ignore[no-untyped-def]
    # A place costs the height of the thing's middle above the deepest column, and half of the
    # hollow it would close off; it saves what its sides share with others or with the walls.
    depth, width = under.shape
    deepest = height.max()
    best = np.inf
    best_z, best_y, best_x = -1, 0, 0
    middle, thickness, columns = _body(under, over)
    if columns == 0:
        return -1, 0, 0, np.inf
    rim = _rim(under)
    # At most half the thing's thickness and four rows: neighbours attract, they do not lift.
    saving = 0.5 * thickness + 4.0
    for z in range(z0, min(z1, height.shape[0] - depth + 1)):
        for x in range(x0, min(x1, height.shape[1] - width + 1)):
            # Higher than any gap, so that the first column decides.
            y = 1 << 20
            total = 0.0
            lost = False
            for i in range(depth):
                for k in range(width):
                    if under[i, k] > BLOCKED:
                        gap = height[z + i, x + k] - under[i, k]
                        total += gap
                        y = min(y, gap)
                # No later column can make this place better than the best: stop early.
                # A blocked column gives a gap far below half of BLOCKED, and ends it at once.
                if y < BLOCKED // 2 or deepest - y - middle - saving >= best:
                    lost = True
                    break
            if lost:
                continue
            cost = deepest - y - middle + 0.5 * (total / columns - y)
            if cost - saving >= best or not _fits(ceiling, under, over, z, y, x):
                continue
            cost -= saving * _sheltered(height, rim, z, y + middle, x)
            if cost < best:
                best = cost
                best_z, best_y, best_x = z, y, x
    return best_z, best_y, best_x, best


@njit(cache=True, nogil=True)
def _body(under, over):  # type: ignore[no-untyped-def]
    middle, thickness, columns = 0.0, 0.0, 0
    for i in range(under.shape[0]):
        for k in range(under.shape[1]):
            if under[i, k] > BLOCKED:
                middle += 0.5 * (under[i, k] + over[i, k])
                thickness += under[i, k] - over[i, k]
                columns += 1
    return middle / max(columns, 1), thickness / max(columns, 1), columns


@njit(cache=True, nogil=True)
def _rim(under):  # type: ignore[no-untyped-def]
    # The empty columns beside the thing, as offsets.
    depth, width = under.shape
    found = []
    for i in range(-1, depth + 1):
        for k in range(-1, width + 1):
            if 0 <= i < depth and 0 <= k < width and under[i, k] > BLOCKED:
                continue
            for a, b in ((i - 1, k), (i + 1, k), (i, k - 1), (i, k + 1)):
                if 0 <= a < depth and 0 <= b < width and under[a, b] > BLOCKED:
                    found.append((i, k))
                    break
    return np.array(found)


@njit(cache=True, nogil=True)
def _fits(ceiling, under, over, z, y, x):  # type: ignore[no-untyped-def]
    for i in range(under.shape[0]):
        for k in range(under.shape[1]):
            if under[i, k] > BLOCKED and y + over[i, k] < ceiling[z + i, x + k]:
                return False
    return True


@njit(cache=True, nogil=True)
def _sheltered(height, rim, z, level, x):  # type: ignore[no-untyped-def]
    # The share of the columns beside the thing that rise to its middle.
    count = 0
    for n in range(rim.shape[0]):
        i, k = z + rim[n, 0], x + rim[n, 1]
        # The bag's wall shelters too: things go into corners.
        outside = i < 0 or k < 0 or i >= height.shape[0] or k >= height.shape[1]
        if outside or height[i, k] <= level:
            count += 1
    return count / rim.shape[0]
