"""One line of the table, and the clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class Row:
    """One thing measured.

    Parameters
    ----------
    what : str
        The thing.
    work : str
        On what.
    ours : str
        Our figure with its unit.
    peer : str
        Whose figure, and it; the paper's own, in quotes, was measured in 2012.
    ratio : str
        Ours over the peer's, both of this run.
    goal : str
        What is to be reached.
    met : bool, optional
        None where it was not measured.
    """

    what: str
    work: str
    ours: str
    peer: str = ""
    ratio: str = ""
    goal: str = ""
    met: bool | None = None

    @classmethod
    def not_measured(cls, what: str, work: str, why: str, goal: str) -> Row:
        """Return a row for what this machine cannot do."""
        return cls(what, work, f"{NOT_MEASURED} ({why})", goal=goal)


WAKING_SECONDS = 4.0


def best_ms(
    work: Callable[[], Any],
    repeats: int = 3,
    warm: bool = True,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Return the shortest of some runs in ms; a first one, which may compile, does not count."""
    if warm:
        work()
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times) * 1e3


def awake_ms(work: Callable[[], Any], repeats: int = 3) -> float:
    """Return the shortest of some runs in ms, once a graphics card has worked for some seconds.

    An idle card runs at a fifth of its clock. It takes most of a second to notice work that keeps
    it busy, and longer where it waits for the processor half the time.
    """
    begun = time.perf_counter()
    while time.perf_counter() - begun < WAKING_SECONDS:
        work()
    return best_ms(work, repeats)


def paired_ms(
    ours: Callable[[], Any],
    peer: Callable[[], Any],
    pairs: int = 3,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, float, float]:
    """Measure two works in turn, so that a busy machine is busy for both.

    Parameters
    ----------
    ours, peer : callable
    pairs : int
        How often both are run.
    clock : callable
        Tells seconds: `time.process_time` for those of all cores.

    Returns
    -------
    ours, peer : float
        The shortest of each, ms.
    ratio : float
        The median over the pairs.
    """
    times = [(best_ms(ours, 1, not i, clock), best_ms(peer, 1, not i, clock)) for i in range(pairs)]
    ratio = median(a / b for a, b in times)
    return min(a for a, _ in times), min(b for _, b in times), ratio


def ms(value: float) -> str:
    """Write milliseconds as people read them."""
    if value < 10:
        return f"{value:.2f} ms"
    return f"{value:.0f} ms" if value < 1000 else f"{value / 1000:.2f} s"
