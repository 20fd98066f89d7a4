"""The table of objects as a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from napari_unpack.io.atomic import written_whole

if TYPE_CHECKING:
    import pandas as pd


def save_objects_csv(objects: pd.DataFrame, path: str | Path) -> Path:
    """Write a table of objects, one row an object, the ID first.

    Parameters
    ----------
    objects : DataFrame
        Indexed by ID, such as `Segmentation.objects` or `Session.objects`.
    path : str or Path
        The file; its folder must exist.

    Returns
    -------
    Path
        What was written.
    """
    target = Path(path)
    with written_whole(target) as temporary:
        objects.to_csv(temporary, index_label="id", float_format="%.6g", lineterminator="\n")
    return target
