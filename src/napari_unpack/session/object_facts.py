"""What is known of one object: its size, its densities and its neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import triple

if TYPE_CHECKING:
    from napari_unpack.session.session import Session


@dataclass(frozen=True)
class Facts:
    """What is known of an object.

    Parameters
    ----------
    name : str
    size_mm : (float, float, float)
        Edges of its tightest box, the longest first.
    volume_mm3 : float
    mean, spread : float
        Of its densities: mean and standard deviation; NaN where none is finite.
    confidence : float
        NaN where it is not known.
    neighbours : tuple of int
        Objects that share a voxel's face with it, the most faces first.
    reasons : tuple of str
        What lowered its confidence, in words.
    """

    name: str
    size_mm: tuple[float, float, float]
    volume_mm3: float
    mean: float
    spread: float
    confidence: float
    neighbours: tuple[int, ...]
    reasons: tuple[str, ...] = ()


def facts_of(session: Session, object_id: int) -> Facts:
    """Measure an object; tenths of a second for a large one, on any thread.

    Parameters
    ----------
    session : Session
    object_id : int

    Raises
    ------
    KeyError
        If there is no such object.
    """
    # Read once: labels and boxes of different revisions do not fit each other.
    bag = session.bag
    window = bag.boxes.slices(object_id, margin=1)
    labels = bag.labels[window]
    mine = labels == object_id
    densities = np.asarray(session.volume[window])[mine].astype(np.float64)
    densities = densities[np.isfinite(densities)]
    row = session.objects.loc[object_id]
    long, middle, short = (float(v) for v in bag.oriented(object_id).size)
    return Facts(
        str(row["name"]),
        (long, middle, short),
        float(row["volume_mm3"]),
        float(densities.mean()) if densities.size else float("nan"),
        float(densities.std()) if densities.size else float("nan"),
        float(row["confidence"]),
        _neighbours(labels, object_id),
        reasons_of(session, object_id) if np.isfinite(float(row["confidence"])) else (),
    )


def reasons_of(session: Session, object_id: int) -> tuple[str, ...]:
    """Say what lowered an object's confidence; tenths of a second, on any thread.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    from napari_unpack.segmentation.common.density_regions import air_offset
    from napari_unpack.segmentation.common.region import Region
    from napari_unpack.segmentation.confidence.features import features
    from napari_unpack.segmentation.confidence.oracle import Oracle, default_oracle
    from napari_unpack.segmentation.confidence.reasons import reasons

    oracle = session.label_editor.oracle or default_oracle()
    if not isinstance(oracle, Oracle):
        return ()
    bag = session.bag
    box = bag.boxes.slices(object_id)
    mask, spacing = bag.labels[box] == object_id, triple(session.spacing)
    air = air_offset(session.volume, bag.labels)
    region = Region.of(mask, session.volume, box, spacing, air)
    return reasons(oracle, features(region))


def _neighbours(labels: NDArray[np.uint16], object_id: int) -> tuple[int, ...]:
    counts: dict[int, int] = {}
    mine = labels == object_id
    for axis in range(3):
        here, there = np.moveaxis(mine, axis, 0), np.moveaxis(labels, axis, 0)
        for own, other in ((here[1:], there[:-1]), (here[:-1], there[1:])):
            for label, faces in zip(
                *np.unique(other[own & (other > 0)], return_counts=True), strict=True
            ):
                counts[int(label)] = counts.get(int(label), 0) + int(faces)
    return tuple(sorted(counts.keys() - {object_id}, key=lambda i: (-counts[i], i)))
