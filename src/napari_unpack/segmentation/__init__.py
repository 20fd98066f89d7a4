"""Volume to labels by a network and classifiers, or by the paper's recursive cuts; evaluation."""

from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.confidence.oracle import Oracle
from napari_unpack.segmentation.evaluation import score, score_by, score_objects
from napari_unpack.segmentation.pipeline import Segmentation, segment
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
