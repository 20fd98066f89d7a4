"""Volume to labels: foreground, components, recursive isoperimetric splitting, evaluation."""

from napari_unpack.segmentation.confidence import Oracle
from napari_unpack.segmentation.evaluation import score
from napari_unpack.segmentation.pipeline import Segmentation, segment
from napari_unpack.segmentation.region import Region

__all__ = ["Oracle", "Region", "Segmentation", "score", "segment"]
