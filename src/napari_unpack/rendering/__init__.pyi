from .api import interference_in, object_id_layers, occlusion, occlusion_ratios, pick, render
from .casting import (
    TransferFunctionLike,
    cast_ids,
    cast_occlusion,
    cast_runs,
    cast_tinted,
    rays_for,
)

__all__ = [
    "TransferFunctionLike",
    "cast_ids",
    "cast_occlusion",
    "cast_runs",
    "cast_tinted",
    "interference_in",
    "object_id_layers",
    "occlusion",
    "occlusion_ratios",
    "pick",
    "rays_for",
    "render",
]
