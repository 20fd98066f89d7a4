"""Masked arrays of numpy: what is masked was not measured, or belongs to no object."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def unmasked(array: ArrayLike, nothing: float) -> NDArray[Any]:
    """Return a plain array, the one given where it is one.

    Parameters
    ----------
    array : array_like
        A masked array, or any other.
    nothing : float
        What stands for what is masked: NaN in volumes, for which whole numbers become float32,
        and 0 in labels.
    """
    if not isinstance(array, np.ma.MaskedArray):
        return np.asarray(array)
    # What holds no numbers is refused later, by what is wrong with it.
    if not np.ma.is_masked(array) or array.dtype.kind not in "biuf":
        return np.asarray(array.data)
    whole = array.dtype.kind != "f"
    found: Any = array.astype(np.float32) if whole and np.isnan(nothing) else array
    return np.asarray(found.filled(nothing))
