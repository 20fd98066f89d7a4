"""How long long work is silent: between two checks for Cancel, and while its bar stands."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks import scale
from benchmarks.row import Row, ms
from benchmarks.scenes import Scenes
from napari_unpack.tasks import Progress

MOST_SECONDS_BETWEEN_CHECKS = 0.5
MOST_SECONDS_OF_A_STANDING_BAR = 2.0
# What goes on in a library's code once nobody waits for it any more.
MOST_SECONDS_IN_THE_BACKGROUND = 2.0
# The largest volume whose every voxel the methods see; larger ones are reduced first.
WORKING_SHAPE = (200, 200, 400)


@dataclass
class Silences:
    """A progress that measures the longest of both, stage by stage.

    Parameters
    ----------
    check, move : dict of str to (float, float)
        By stage: seconds, and those of the processor meanwhile.
    """

    check: dict[str, tuple[float, float]] = field(default_factory=dict)
    move: dict[str, tuple[float, float]] = field(default_factory=dict)
    _checked: tuple[float, float] = (0.0, 0.0)
    _moved: tuple[float, float] = (0.0, 0.0)
    _furthest: float = -1.0
    _doing: str = ""

    def __call__(self, fraction: float, text: str) -> None:
        """Take note of a report."""
        now = time.perf_counter(), time.process_time()
        if self._doing:
            _note(self.check, self._doing, self._checked, now)
        if fraction > self._furthest:
            if self._doing:
                _note(self.move, self._doing, self._moved, now)
            self._moved, self._furthest = now, fraction
        self._checked = now
        # Counts and names of what is in work are no stages.
        self._doing = text.partition(":")[0].rstrip("0123456789. ") or text


def _note(
    longest: dict[str, tuple[float, float]],
    stage: str,
    since: tuple[float, float],
    now: tuple[float, float],
) -> None:
    silence = now[0] - since[0], now[1] - since[1]
    longest[stage] = max(longest.get(stage, (0.0, 0.0)), silence)


def measure(scenes: Scenes) -> list[Row]:
    rows: list[Row] = []
    for what, work in _works(scenes):
        silences = Silences()
        silences(0.0, "Beginning")
        work(silences)
        silences(1.0, "")
        rows += _rows(what, silences)
    return rows


def _rows(what: str, silences: Silences) -> Iterator[Row]:
    """Yield a row for the whole, and one for each stage that is silent for a tenth of a second."""
    most = MOST_SECONDS_BETWEEN_CHECKS
    if what.endswith("in the background"):
        most = MOST_SECONDS_IN_THE_BACKGROUND
    (check, busy), (move, _) = (max(d.values()) for d in (silences.check, silences.move))
    longest = max(silences.check, key=lambda stage: silences.check[stage])
    yield Row(
        "longest silence",
        what,
        f"check {ms(1e3 * check)} ({longest}), bar {ms(1e3 * move)}",
        peer=f"{ms(1e3 * busy)} of the processor",
        goal=f"<= {most} s, <= {MOST_SECONDS_OF_A_STANDING_BAR:.0f} s",
        met=check <= most and move <= max(most, MOST_SECONDS_OF_A_STANDING_BAR),
    )
    for stage, (seconds, processor) in silences.check.items():
        if seconds >= 0.1:
            standing = silences.move.get(stage, (0.0, 0.0))[0]
            yield Row(
                "",
                f"- {stage}",
                f"check {ms(1e3 * seconds)}, bar {ms(1e3 * standing)}",
                peer=f"{ms(1e3 * processor)} of the processor",
            )


def _works(scenes: Scenes) -> Iterator[tuple[str, Callable[[Progress], Any]]]:
    from napari_unpack import segment
    from napari_unpack.io import movie, save_objects_page, save_session
    from napari_unpack.io.surfaces import save_surfaces
    from napari_unpack.segmentation import pipeline
    from napari_unpack.segmentation.training import train_on_examples
    from napari_unpack.session import Session

    scale.load_kernels()
    large, middle = (2, 1) if scenes.quick else (4, 2)
    whole = np.load(scale.prepared(middle))
    part = whole if scenes.quick else _middle_of(whole, WORKING_SHAPE)
    spacing = (scale.SPACING / middle,) * 3
    named = "x".join(map(str, part.shape))
    found = []
    work = partial(segment, part, spacing)
    yield f"segmenting {named}", lambda told: found.append(work(progress=told))

    def alone(told: Progress) -> None:
        with patch.object(pipeline, "relayed", lambda work, progress: work(progress)):
            work(progress=told)

    yield f"segmenting {named}, in the background", alone
    labels = found[0].labels
    examples = found[0].objects.index.tolist()
    yield (
        f"training on {len(examples)} objects",
        lambda told: train_on_examples(part, labels, spacing, examples, progress=told),
    )
    session = Session(part, labels, spacing=spacing)
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".mp4", ".gif"):
            film = partial(movie, session, Path(folder) / f"film{suffix}", 2, backend="cpu")
            yield f"a film, {suffix}", lambda told, film=film: film(progress=told)
        for save, name in (
            (partial(save_objects_page, backend="cpu"), "page.html"),
            (save_surfaces, "surfaces.stl"),
        ):
            target = Path(folder) / name
            yield (
                f"{name} of {len(examples)} objects",
                lambda told, save=save, target=target: save(session, target, progress=told),
            )
        volume = np.load(scale.prepared(large))
        spacing = (scale.SPACING / large,) * 3
        named = "x".join(map(str, volume.shape))
        yield (
            f"segmenting {named}",
            lambda told: found.append(segment(volume, spacing, progress=told)),
        )
        session = Session(volume, found[-1].labels, spacing=spacing)
        yield (
            f"saving {named}",
            lambda told: save_session(session, Path(folder) / "bag.unpack", progress=told),
        )


def _middle_of(volume: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    first = [(n - k) // 2 for n, k in zip(volume.shape, shape, strict=True)]
    return volume[tuple(slice(a, a + k) for a, k in zip(first, shape, strict=True))].copy()
