"""Which objects a confidence can be trained on, and how many it takes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

FEWEST = 8
"""Objects that a model is trained on at least."""

SMALLEST = 64
"""Voxels: the shape of less is that of its voxels."""


def usable_examples(
    examples: Iterable[int], ids: NDArray[np.integer], voxels: NDArray[np.integer]
) -> int:
    """Return how many of the objects marked as examples are large enough to learn from.

    Parameters
    ----------
    examples : iterable of int
        IDs.
    ids : (N,) ndarray of int
        Of all objects.
    voxels : (N,) ndarray of int
        Of each.
    """
    return int(np.count_nonzero(voxels[np.isin(ids, list(examples))] >= SMALLEST))
