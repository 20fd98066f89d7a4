"""Volume to labels: foreground, components, recursive isoperimetric splitting, evaluation."""

from napari_unpack.segmentation.confidence import Oracle
from napari_unpack.segmentation.evaluation import score
from napari_unpack.segmentation.evaluation_by_object import score_by, score_objects
from napari_unpack.segmentation.pipeline import Segmentation, segment
from napari_unpack.segmentation.region import Region
from napari_unpack.segmentation.training import train

__all__ = [
    "Oracle",
    "Region",
    "Segmentation",
    "score",
    "score_by",
    "score_objects",
    "segment",
    "train",
]
