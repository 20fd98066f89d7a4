"""The three layers as tables of objects: what **Duplicate** and **Save** make of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from napari_unpack.appearance import tints_of
from napari_unpack.layers.compat import PictureLayer
from napari_unpack.session.quantities import volume_words

if TYPE_CHECKING:
    from napari_unpack.session import Session


def set_table(layer: PictureLayer, session: Session, ids: Iterable[int]) -> None:
    """Make a layer the table of some objects.

    Parameters
    ----------
    layer : PictureLayer
        Becomes a Points layer of their centres when it is duplicated or saved: in their hues,
        with `session.objects` as features.
    session : Session
    ids : iterable of int
        Which, those unknown to the session's boxes left out.
    """
    # States may still name an object that a repair has just removed.
    known = sorted(set(ids) & set(session.boxes.ids.tolist()))
    rows = [session.boxes.index(i) for i in known]
    low, high = session.boxes.lower[rows], session.boxes.upper[rows]
    edges = (high - low).max(axis=1) if rows else np.zeros(0)
    own = session.annotations.colors
    tints = tints_of(session.hues, session.ids[-1], mode=session.tint_mode, colors=own)
    layer.set_table(
        (low + high - 1) / 2,
        features=_features(session.objects, known),
        face_color=tints[known, :3],
        border_color="transparent",
        # Points to be seen, but that leave their neighbours visible.
        size=np.maximum(edges / 6, 1.0),
    )


def describe(session: Session, object_id: int) -> str:
    """Return what an object is called, and its confidence where there is one.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    row = session.objects.loc[object_id]
    name = str(row.get("name", f"Object {session.label_of(object_id)}"))
    confidence = float(row.get("confidence", np.nan))
    return name if np.isnan(confidence) else f"{name}, confidence {confidence:.2f}"


def hint(session: Session, object_id: int) -> str:
    """Return what the mouse is on, in few words: name and volume.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    row = session.objects.loc[object_id]
    return f"{row['name']}, {volume_words(float(row['volume_mm3']), session.length_unit)}"


def _features(objects: pd.DataFrame | None, ids: list[int]) -> pd.DataFrame:
    if objects is None:
        return pd.DataFrame({"id": ids})
    return objects.reindex(ids).rename_axis("id").reset_index()
