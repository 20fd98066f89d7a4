"""One short fingerprint for whatever the public functions return."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd

DIGITS = 6
"""Of the numbers in tables; pictures, hues and ratios are taken to the last bit."""


def digest(value: Any) -> str:
    """Return the SHA-256 of a value: type, shape and every bit of arrays, the order of lists.

    Parameters
    ----------
    value : ndarray, DataFrame, Graph, mapping, list, tuple, number, str or None
        Mappings and graphs are taken in the order of their keys.

    Returns
    -------
    str
        Hexadecimal.
    """
    if isinstance(value, np.ndarray):
        found = hashlib.sha256(f"{value.dtype.str} {value.shape} ".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    else:
        found = hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode())
    return found.hexdigest()


def plain(value: Any) -> Any:
    """Return a value as JSON knows it, without losing a bit.

    Parameters
    ----------
    value : object
        As for `digest`; arrays within others become their digests.

    Returns
    -------
    object

    Raises
    ------
    TypeError
        If it is of a kind not foreseen.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float | np.floating):
        return repr(float(value))
    if isinstance(value, np.bool_ | np.integer):
        return value.item()
    if isinstance(value, np.ndarray):
        return digest(value)
    if isinstance(value, Mapping):
        return {str(key): plain(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, pd.DataFrame):
        table = value.round(DIGITS)
        columns = {str(name): table[name].tolist() for name in table}
        return plain({"index": [str(i) for i in table.index], **columns})
    if isinstance(value, nx.Graph):
        edges = sorted((*sorted(pair), weight) for *pair, weight in value.edges(data="weight"))
        return [sorted(value.nodes), edges]
    raise TypeError(f"no digest of {type(value).__name__} is foreseen")
