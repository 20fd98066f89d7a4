"""The package's own segmentation: the learned method and the paper's."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from benchmarks.segmentation.peers import Found
from napari_unpack.segmentation import segment

CUTS = "ours, cuts and oracle"


def with_all(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield what a user gets from Segment."""
    yield "ours", segment(volume, spacing).labels


def as_the_paper(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield recursive cuts judged by the oracle, the method of the paper."""
    yield CUTS, segment(volume, spacing, method="cuts").labels


OURS = (
    (CUTS, as_the_paper),
    ("ours", with_all),
)
