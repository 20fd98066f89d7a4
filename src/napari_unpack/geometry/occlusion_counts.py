"""Occlusion counts of every object along one direction, of which occlusion ratios are made.

Both backends return them and `unpacking` reads them, so they stand below all of these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Above this many objects there is no table of who blocks whom: it grows with their square.
MOST_IN_TABLE = 4096


@dataclass(frozen=True, eq=False)
class SparseTable:
    """A table by ID that holds the IDs there are and is 0 elsewhere, read as an array is.

    Parameters
    ----------
    ids : (n,) ndarray of int64
        Ascending.
    values : (n,) ndarray
        Of these IDs.
    """

    ids: NDArray[np.int64]
    values: NDArray[Any]

    def __len__(self) -> int:
        return int(self.ids[-1]) + 1

    def __getitem__(self, wanted: ArrayLike) -> Any:
        """Return the value of an ID, or those of an array of IDs."""
        places = np.minimum(np.searchsorted(self.ids, wanted), len(self.ids) - 1)
        return np.where(self.ids[places] == wanted, self.values[places], 0)[()]

    def sum(self) -> Any:
        """Return the sum over all IDs."""
        return self.values.sum()


Table: TypeAlias = NDArray[np.int64] | NDArray[np.float64] | SparseTable


@dataclass(frozen=True, eq=False)
class OcclusionCounts:
    """Samples and rays of every object, as met by orthographic rays looking along -D.

    Every array but `ids` and `blocks` has one entry an ID, 0 to M - 1; hidden objects and the
    background have 0 everywhere. Where an ID is above 65,535 these are a `SparseTable` each.

    Parameters
    ----------
    ids : (n,) ndarray of int64
        Visible objects met by at least one ray, ascending.
    samples : (M,) ndarray of int64
        All samples in the object: the denominator of eq. 2.
    hits : (M,) ndarray of int64
        Rays that meet the object.
    occluded_hits : (M,) ndarray of int64
        Rays that meet it whose first object is another.
    occluded_samples : (M,) ndarray of int64
        Samples on such rays: the numerator of eq. 2.
    exact_samples : (M,) ndarray of int64
        Samples with any other visible object in front of them on their ray.
    blocks : (n, n) ndarray of bool, optional
        Whether any sample of the row's object lies in front of a sample of the column's, over
        `ids`. None where there are more than 4096 objects.
    front_area : (M,) ndarray of float64, optional
        Pixels covered by the front faces of the object's bounding box (`rendering.occlusion`
        fills it in): the paper's approximate denominator.
    """

    ids: NDArray[np.int64]
    samples: Table
    hits: Table
    occluded_hits: Table
    occluded_samples: Table
    exact_samples: Table
    blocks: NDArray[np.bool_] | None = None
    front_area: Table | None = None

    @property
    def listing_samples(self) -> Table:
        """The counters of the paper's single-pass listing, (M,) int64.

        Notes
        -----
        Li et al. 2012, section 5.1, `countOccludedSamples`, with the loop advancing on
        `continue` as was meant (docs/paper.md, R2). It adds up the run lengths of whatever is
        not the ray's first object, which is eq. 2's numerator exactly: cutting a sum into runs
        does not change it. A test holds a literal transcription against it.
        """
        return self.occluded_samples
