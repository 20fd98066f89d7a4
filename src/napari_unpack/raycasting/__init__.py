"""The ray caster for the CPU: numba kernels over bands of rows, on as many threads as cores."""

from napari_unpack.geometry.counts import OcclusionCounts
from napari_unpack.raycasting.bricks import Bricks
from napari_unpack.raycasting.object_ids import id_layers
from napari_unpack.raycasting.occlusion import occlusion_counts, occlusion_runs
from napari_unpack.raycasting.picking import by_contribution, contributions
from napari_unpack.raycasting.relabelling import relabelled
from napari_unpack.raycasting.right_of_way import WAY
from napari_unpack.raycasting.tallies import Runs
from napari_unpack.raycasting.tinted import tinted

__all__ = [
    "WAY",
    "Bricks",
    "OcclusionCounts",
    "Runs",
    "by_contribution",
    "contributions",
    "id_layers",
    "occlusion_counts",
    "occlusion_runs",
    "relabelled",
    "tinted",
]
