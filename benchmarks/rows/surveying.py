"""Which object blocks which along 26 directions, for the best direction and for Reveal."""

from __future__ import annotations

from time import process_time

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, Scenes
from napari_unpack.session import Session
from napari_unpack.tasks import no_progress

WORK = "60 objects, 384x384x512, <= 512 rays a side"
GOAL = "<= 3 s CPU"


def measure(scenes: Scenes) -> list[Row]:
    crowd = scenes.crowd
    session = Session(crowd.volume, crowd.labels, MM)
    session.backend = "cpu"
    one = session.queries.occlusion_task()
    survey = session.queries.survey_task()
    assert one is not None
    assert survey is not None
    single = best_ms(lambda: one.run(no_progress), scenes.repeats)
    began = process_time()
    whole = best_ms(lambda: survey.run(no_progress), 1, warm=False)
    spent = process_time() - began
    return [
        Row(
            "blocking table over 26 directions",
            WORK,
            f"{ms(whole)} ({spent:.1f} s of processor time)",
            f"one direction, voxel pitch: {ms(single)}",
            f"{whole / single:.1f}",
            GOAL,
            whole <= 3000,
        )
    ]
