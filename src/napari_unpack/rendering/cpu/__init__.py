"""The backend on the CPU: numba kernels over bands of rows, on as many threads as cores."""

from napari_unpack.appearance import interference
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.rendering.cpu.bricks import Bricks, relabelled
from napari_unpack.rendering.cpu.label_runs import Runs
from napari_unpack.rendering.cpu.object_ids import id_layers
from napari_unpack.rendering.cpu.occlusion import occlusion_counts, occlusion_runs
from napari_unpack.rendering.cpu.picking import by_contribution, contributions
from napari_unpack.rendering.cpu.thread_pool import CANCELLING, INTERACTIVE_PRIORITY
from napari_unpack.rendering.cpu.tinted import tinted

__all__ = [
    "CANCELLING",
    "INTERACTIVE_PRIORITY",
    "Bricks",
    "OcclusionCounts",
    "Runs",
    "by_contribution",
    "contributions",
    "id_layers",
    "interference",
    "occlusion_counts",
    "occlusion_runs",
    "relabelled",
    "tinted",
]
