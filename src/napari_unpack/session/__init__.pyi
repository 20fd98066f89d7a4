from .errors import BlockedError, NobodyFreeError
from .events import LogEntry
from .object_state import ObjectState
from .occlusion import OcclusionResult
from .ray_queries import RayQueries
from .session import Session

__all__ = [
    "BlockedError",
    "LogEntry",
    "NobodyFreeError",
    "ObjectState",
    "OcclusionResult",
    "RayQueries",
    "Session",
]
