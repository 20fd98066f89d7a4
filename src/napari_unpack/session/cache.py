"""Results under the keys they depend on: a stale one is never found; a few of a kind are kept."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from operator import eq
from threading import Lock
from typing import Any, TypeVar

K = TypeVar("K", bound=Hashable)

# Results of one kind: D's, that of the direction asked for last, and one to go back to.
MOST_RESULTS = 3


class ResultCache:
    """Results by kind and key, the least recently used dropped first; for any thread."""

    def __init__(self) -> None:
        self._kinds: dict[type, dict[Hashable, Any]] = {}
        self._lock = Lock()

    def find(self, wanted: K, covers: Callable[[Any, K], bool] = eq) -> Any:
        """Return the latest result that serves a key, None where there is none.

        Parameters
        ----------
        wanted : hashable
        covers : callable
            Given a known key and the wanted one, tells whether its result serves.
        """
        with self._lock:
            kind = self._kinds.get(type(wanted), {})
            key: Hashable = wanted
            if wanted not in kind and covers is not eq:
                key = next((known for known in reversed(kind) if covers(known, wanted)), wanted)
            if key not in kind:
                return None
            # What is asked for again and again must outlive what was asked for once.
            found = kind[key] = kind.pop(key)
            return found

    def take(self, wanted: Hashable) -> Any:
        """Return the result under a key and keep it no longer; None where there is none."""
        with self._lock:
            return self._kinds.get(type(wanted), {}).pop(wanted, None)

    def keep(
        self,
        key: K,
        result: Any,
        most: int = MOST_RESULTS,
        replaces: Callable[[Any, K], bool] = eq,
    ) -> None:
        """Keep a result.

        Parameters
        ----------
        key : hashable
        result : object
        most : int
            How many results of this kind.
        replaces : callable
            Given a known key and this one, tells whether this result takes its place.
        """
        with self._lock:
            kind = self._kinds.setdefault(type(key), {})
            for known in tuple(kind):
                if replaces(known, key):
                    del kind[known]
            kind[key] = result
            for oldest in tuple(kind)[:-most]:
                del kind[oldest]
