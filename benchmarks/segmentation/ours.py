"""The package's own segmentation, with and without what it has learned."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.peers import Found
from napari_unpack.segmentation import segment
from napari_unpack.segmentation.checks import checked_spacing, checked_volume
from napari_unpack.segmentation.merging import absorb_small, fill_cavities
from napari_unpack.segmentation.pipeline import split_parts
from napari_unpack.segmentation.ranking import rank_labels

CUTS = "ours, cuts and oracle"


def with_all(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield what a user gets from Segment."""
    yield "ours", segment(volume, spacing).labels


def without_network(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield our parts, joined by the judge of pairs."""
    yield "ours, no network", segment(volume, spacing, method="affinity").labels


def as_the_paper(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield recursive cuts judged by the oracle, the method of the paper."""
    yield CUTS, segment(volume, spacing, method="cuts").labels


def unlearned(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield our parts, taken apart by shape and material and judged by nobody."""
    density, size = checked_volume(volume), checked_spacing(spacing)
    parts, _ = split_parts(density, size, lambda fraction, text: None)
    parts = absorb_small(parts, size, max(500.0, 100 * float(np.prod(size))))
    yield "ours, nothing learned", rank_labels(fill_cavities(parts, size))


OURS = (
    ("ours, nothing learned", unlearned),
    ("ours, no network", without_network),
    (CUTS, as_the_paper),
    ("ours", with_all),
)
