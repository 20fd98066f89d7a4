from .appearance import TransferFunction, assign_hues, interference
from .batches import BatchReport, batch
from .geometry.view import View
from .io import movie, open_session, save_session
from .rendering import object_id_layers, occlusion_ratios, pick, render
from .segmentation import Oracle, score, score_by, score_objects, segment, train
from .session import Session
from .simulation import simulate_bag
from .version import __version__

__all__ = [
    "BatchReport",
    "Oracle",
    "Session",
    "TransferFunction",
    "View",
    "__version__",
    "assign_hues",
    "batch",
    "interference",
    "movie",
    "object_id_layers",
    "occlusion_ratios",
    "open_session",
    "pick",
    "render",
    "save_session",
    "score",
    "score_by",
    "score_objects",
    "segment",
    "simulate_bag",
    "train",
]
