from .asking import Casters, OcclusionAnswer, OcclusionQuestion
from .errors import BlockedError, NobodyFreeError
from .events import LogEntry
from .object_state import ObjectState
from .session import Session

__all__ = [
    "BlockedError",
    "Casters",
    "LogEntry",
    "NobodyFreeError",
    "ObjectState",
    "OcclusionAnswer",
    "OcclusionQuestion",
    "Session",
]
