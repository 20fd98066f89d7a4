from .casting import (
    TransferFunctionLike,
    cast_ids,
    cast_occlusion,
    cast_runs,
    cast_tinted,
    rays_for,
)
from .counting import occlusion, occlusion_ratios
from .interfering import interference_in
from .pictures import object_id_layers, pick, render

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
