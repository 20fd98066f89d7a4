"""The package's own segmentation, with and without what it has learned."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.peers import Found
from napari_unpack.segmentation import segment
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.region import default_smallest
from napari_unpack.segmentation.common.validation import checked_spacing, checked_volume
from napari_unpack.segmentation.foreground.denoising import flattened, is_grainy
from napari_unpack.segmentation.isoperimetric.initial_parts import split_parts
from napari_unpack.segmentation.isoperimetric.splitting import SplitRule
from napari_unpack.segmentation.object_table import rank_labels
from napari_unpack.segmentation.postprocessing.cavities import fill_cavities

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
    smallest = default_smallest(density.shape, size)
    bag = not is_grainy(density)
    if not bag:
        density = flattened(density, size)
    parts, _ = split_parts(
        density,
        size,
        lambda fraction, text: None,
        supports=bag,
        shell=bag,
        rule=SplitRule(smallest=smallest / 2),
    )
    parts = absorb_small(parts, size, max(smallest, 100 * float(np.prod(size))))
    yield "ours, nothing learned", rank_labels(fill_cavities(parts, size))


OURS = (
    ("ours, nothing learned", unlearned),
    ("ours, no network", without_network),
    (CUTS, as_the_paper),
    ("ours", with_all),
)
