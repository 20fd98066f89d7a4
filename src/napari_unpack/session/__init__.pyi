from .asking import Casters, OcclusionAnswer, OcclusionQuestion
from .errors import BlockedError, NobodyFreeError
from .events import LogEntry
from .session import Session
from .state import ObjectState

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
