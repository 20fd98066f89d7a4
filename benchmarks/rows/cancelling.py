"""How long a segmentation is silent: between two checks for Cancel, and while its bar stands."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from benchmarks import scale
from benchmarks.row import Row, ms
from benchmarks.scenes import Scenes

MOST_SECONDS_BETWEEN_CHECKS = 0.5
MOST_SECONDS_OF_A_STANDING_BAR = 2.0


@dataclass
class Silences:
    """A progress that measures the longest of both.

    Parameters
    ----------
    check, move : (float, str)
        Seconds, and what was being done.
    """

    check: tuple[float, str] = (0.0, "")
    move: tuple[float, str] = (0.0, "")
    _last: tuple[float, float, float, str] | None = field(default=None, init=False)

    def __call__(self, fraction: float, text: str) -> None:
        """Take note of a report."""
        now = time.perf_counter()
        checked, moved, furthest, doing = self._last or (now, now, -1.0, text)
        self.check = max(self.check, (now - checked, doing))
        if fraction > furthest:
            self.move = max(self.move, (now - moved, doing))
            moved, furthest = now, fraction
        self._last = (now, moved, furthest, text)


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack import segment

    factor = 2 if scenes.quick else 4
    spacing = (scale.SPACING / factor,) * 3
    volume = np.load(scale.prepared(factor))
    scale.load_kernels()
    silences = Silences()
    silences(0.0, "")
    segment(volume, spacing, progress=silences)
    (check, checking), (move, moving) = silences.check, silences.move
    return [
        Row(
            "longest silence of a segmentation",
            f"{'x'.join(map(str, volume.shape))}: between two checks for Cancel; of the bar",
            f"{ms(1e3 * check)} ({checking}), {ms(1e3 * move)} ({moving})",
            goal=f"<= {MOST_SECONDS_BETWEEN_CHECKS} s, <= {MOST_SECONDS_OF_A_STANDING_BAR:.0f} s",
            met=check <= MOST_SECONDS_BETWEEN_CHECKS and move <= MOST_SECONDS_OF_A_STANDING_BAR,
        )
    ]
