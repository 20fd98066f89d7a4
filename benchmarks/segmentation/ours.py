"""The package's own segmentation: the learned method, the same without one stage, the paper's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.peers import Found
from napari_unpack.segmentation import pipeline, segment
from napari_unpack.segmentation.learned import method, part_splitting

OURS, CUTS = "ours", "ours, cuts and oracle"


@dataclass(frozen=True)
class Stage:
    """A stage of the learned method that can be taken out.

    Parameters
    ----------
    module : module
    name : str
        What the module knows it by.
    instead : object
        What stands in its place.
    """

    module: ModuleType
    name: str
    instead: Any


def _unchanged(labels: Any, *_: Any, **__: Any) -> Any:
    return labels


def _none(labels: NDArray[np.int32], *_: Any, **__: Any) -> NDArray[np.bool_]:
    """Choose no label."""
    return np.zeros(int(labels.max(initial=0)) + 1, np.bool_)


STAGES = {
    "merging parts": Stage(method, "merge_parts", _unchanged),
    # No step of log density is so large.
    "splitting parts": Stage(part_splitting, "SPLIT_STEP", 99.0),
    "merging pieces": Stage(method, "merge_pieces", _unchanged),
    "sharpening": Stage(method, "sharpened", _unchanged),
    "borders": Stage(method, "draw_borders", _unchanged),
    "what the network missed": Stage(method, "with_missed", _unchanged),
    "cases": Stage(method, "find_case", _none),
    "skin": Stage(method, "drop_skin", _unchanged),
    "streaks": Stage(method, "find_streaks", _none),
    "cables": Stage(pipeline, "gather_cables", _unchanged),
    "inclusions": Stage(pipeline, "separate_inclusions", _unchanged),
    "taking off metal's blur": Stage(pipeline, "without_blur", _unchanged),
    "cavities": Stage(pipeline, "fill_cavities", _unchanged),
    "what is suspended": Stage(pipeline, "join_suspended", lambda labels, filled, _: filled),
}
"""What an ablation takes out, one at a time."""


def with_all(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield what a user gets from Segment."""
    yield OURS, segment(volume, spacing).labels


def without(name: str, volume: NDArray[Any], spacing: Any) -> Found:
    """Yield the same, one stage less."""
    stage = STAGES[name]
    with mock.patch.object(stage.module, stage.name, stage.instead):
        yield f"without {name}", segment(volume, spacing).labels


def as_the_paper(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield recursive cuts judged by the oracle, the method of the paper."""
    yield CUTS, segment(volume, spacing, method="cuts").labels


Finder = Callable[[NDArray[Any], Any], Found]
FINDERS: dict[str, Finder] = {
    CUTS: as_the_paper,
    OURS: with_all,
    **{f"without {name}": partial(without, name) for name in STAGES},
}
