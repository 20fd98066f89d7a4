"""A cutting plane and a clipping box of the packed bag, among its clipping planes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import fixed, unit

if TYPE_CHECKING:
    from napari_unpack.session.document import Document

# Planes that went to a napari layer and back differ by rounding.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Cut:
    """What of the clipping planes is a person's cutting plane, and what a clipping box.

    Parameters
    ----------
    plane : (2, 3) ndarray of float64, optional
        Point and unit normal, world mm: what lies behind it is cut away.
    box : (2, 3) ndarray of float64, optional
        Lower and upper corner, world mm: what lies outside is cut away.
    """

    plane: NDArray[np.float64] | None = None
    box: NDArray[np.float64] | None = None

    def plane_rows(self, spacing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the plane as clipping planes, (0 or 1, 2, 3) in voxels."""
        if self.plane is None:
            return np.zeros((0, 2, 3))
        point, normal = self.plane
        return np.stack([point / spacing, unit(normal * spacing)])[None]

    def box_rows(self, spacing: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the sides of the box that cut something, (N, 2, 3) in voxels.

        Parameters
        ----------
        spacing : (3,) ndarray of float64, mm z y x
        shape : (3,) tuple of int
            Voxels of the scan.
        """
        rows = []
        for axis in range(0 if self.box is None else 3):
            assert self.box is not None
            low, high = self.box[:, axis] / spacing[axis]
            side = np.eye(3)[axis]
            # There are eight planes at most, so none is spent on what is outside the scan anyway.
            if low > -0.5 + ROUNDING:
                rows.append((low * side, side))
            if high < shape[axis] - 0.5 - ROUNDING:
                rows.append((high * side, -side))
        return np.array(rows, dtype=np.float64).reshape(-1, 2, 3)

    def rows(self, spacing: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return all its clipping planes, (N, 2, 3) in voxels.

        Parameters
        ----------
        spacing, shape
            As for `box_rows`.
        """
        return np.concatenate([self.plane_rows(spacing), self.box_rows(spacing, shape)])

    def kept(
        self, clipping: NDArray[np.float64], spacing: NDArray[np.float64], shape: tuple[int, ...]
    ) -> Cut:
        """Return what of it is still among clipping planes that others may have changed.

        Parameters
        ----------
        clipping : (N, 2, 3) ndarray of float64
            Voxels.
        spacing, shape
            As for `box_rows`.
        """
        has_plane = len(without(self.plane_rows(spacing), clipping)) == 0
        has_box = len(without(self.box_rows(spacing, shape), clipping)) == 0
        if has_plane and has_box:
            return self
        return Cut(self.plane if has_plane else None, self.box if has_box else None)


class Cutting:
    """The cutting plane and the clipping box of a session, which can be undone.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._doc = document

    @property
    def plane(self) -> NDArray[np.float64] | None:
        """(2, 3) point and unit normal, world mm, or None: what lies behind it is cut away."""
        return self._doc.state.cut.plane

    @plane.setter
    def plane(self, plane: ArrayLike | None) -> None:
        """Take another plane.

        Raises
        ------
        ValueError
            If it is no point and normal, or there are too many planes then.
        """
        self.move_plane(plane, merge=False)

    def move_plane(self, plane: ArrayLike | None, merge: bool = True) -> None:
        """Take another plane, in one step with the last movement, as when dragging.

        Parameters
        ----------
        plane : (2, 3) array_like, optional
        merge : bool
            False makes a step of its own.

        Raises
        ------
        ValueError
            As for `plane`.
        """
        made = None if plane is None else _pair(plane, "plane", "a point and a normal")
        if made is not None:
            made = fixed(np.stack([made[0], unit(made[1], "normal")]))
        self._take("cutting plane", self.plane, made, merge, plane=made)

    @property
    def box(self) -> NDArray[np.float64] | None:
        """(2, 3) lower and upper corner, world mm, or None: what lies outside is cut away."""
        return self._doc.state.cut.box

    @box.setter
    def box(self, box: ArrayLike | None) -> None:
        """Take another box.

        Raises
        ------
        ValueError
            If it is no two corners, or has no inside, or there are too many planes then.
        """
        made = None if box is None else _pair(box, "box", "a lower and an upper corner")
        if made is not None and not (made[0] < made[1]).all():
            raise ValueError(
                f"box must have its lower corner below its upper one, got {made.tolist()}"
            )
        self._take("clipping box", self.box, made, True, box=made)

    def _take(
        self,
        what: str,
        before: NDArray[np.float64] | None,
        after: NDArray[np.float64] | None,
        merge: bool,
        **changes: NDArray[np.float64] | None,
    ) -> None:
        if before is after or (
            before is not None and after is not None and np.array_equal(before, after)
        ):
            return
        verb = "add" if before is None else "remove" if after is None else "move"
        cut = replace(self._doc.state.cut, **changes)
        # What cannot be is refused before it is a step.
        self._doc.clipping_with(cut)
        new = replace(self._doc.state, cut=cut)
        self._doc.commit(f"{verb} the {what}", new, merge and verb == "move")


def without(planes: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the planes that are not among others, (N, 2, 3).

    Parameters
    ----------
    planes, others : (N, 2, 3) ndarray of float64
    """
    away = np.abs(planes[:, None] - others[None]).max(axis=(2, 3), initial=0.0)
    return planes[~(away < ROUNDING).any(axis=1)]


def _pair(value: ArrayLike, name: str, what: str) -> NDArray[np.float64]:
    array = fixed(value)
    if array.shape != (2, 3) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be {what}, (2, 3) finite mm z y x, got {value!r}")
    return array
