from .common.region import Region
from .confidence.oracle import Oracle
from .evaluation import score, score_by, score_objects
from .pipeline import Segmentation, segment
from .training import train

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
