"""Opacities and cuts of objects' own as plain data, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from napari_unpack.appearance import TransferFunction
from napari_unpack.session.fields import Fields
from napari_unpack.session.study import Study


def densities_record(function: TransferFunction) -> dict[str, Any]:
    """Return a transfer function as plain data."""
    colors = function.colors
    return {
        "points": [list(point) for point in function.points],
        "colors": None if colors is None else [[d, list(rgb)] for d, rgb in colors],
    }


def densities_from(fields: Fields) -> TransferFunction:
    """Make the transfer function a record was made of.

    Raises
    ------
    ValueError
        If there is no such function.
    """
    try:
        return TransferFunction(fields["points"], fields["colors"])
    except (TypeError, IndexError) as error:
        raise ValueError(f"session.situation.transfer_function is malformed: {error}") from error


def studies_record(studies: Mapping[int, Study]) -> dict[str, Any]:
    """Return by ID what objects have of their own."""
    return {
        str(i): {
            "transfer_function": None
            if study.transfer_function is None
            else densities_record(study.transfer_function),
            "cut": None if study.cut is None else [np.asarray(v).tolist() for v in study.cut],
        }
        for i, study in studies.items()
    }


def studies_from(fields: Fields, known: frozenset[int]) -> dict[int, Study]:
    """Make what `studies_record` was made of; nothing where older files say nothing of it.

    Raises
    ------
    ValueError
        If the record says something that cannot be.
    """
    if not fields.has("studies"):
        return {}
    studies = {}
    for i, value in fields.by_id("studies", known).items():
        one = Fields(value, f"session.situation.studies.{i}")
        own = None
        if one.has("transfer_function"):
            own = densities_from(one.part("transfer_function"))
        cut = one.array("cut", (2, 3)) if one.has("cut") else None
        if cut is not None and not np.linalg.norm(cut[1]) > 0:
            raise ValueError(f"session.situation.studies.{i}.cut must have a normal that is not 0")
        studies[i] = Study(own, None if cut is None else (cut[0], cut[1]))
    return studies
