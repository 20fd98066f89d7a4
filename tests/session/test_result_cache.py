"""Results by key: which are kept, and under which key what was found on the way stands."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from bags import AxisRays, session_of, stack_of_plates

import napari_unpack as nu
from napari_unpack.session import Session
from napari_unpack.session.cache import MOST_RESULTS, ResultCache
from napari_unpack.tasks import no_progress


def test_what_was_used_longest_ago_goes_first():
    cache = ResultCache()
    for key in range(MOST_RESULTS):
        cache.keep(key, str(key))
    assert cache.find(0) == "0"
    cache.keep(MOST_RESULTS, "new")
    assert cache.find(0) == "0"
    assert cache.find(1) is None
    assert cache.take(0) == "0"
    assert cache.find(0) is None
    assert cache.take(0) is None


def test_a_result_for_more_objects_does_not_pass_for_one_asked_afresh():
    session = session_of(stack_of_plates())
    queries, rays = session.queries, session.ray_queries
    assert isinstance(rays, AxisRays)
    session.direction = "-z"
    everything = queries.packed
    queries.occlusion()
    queries.survey()
    session.unpack(1)
    session.reveal_plan(3)
    asked = rays.asked
    # What was known for all five still serves after the one has come back.
    session.restore()
    assert queries.occlusion().packed == everything
    assert queries.survey_task() is None
    assert rays.asked == asked
    session.unpack(1)
    assert queries.occlusion(afresh=True).packed == everything - {1}


def test_a_result_that_comes_late_does_not_take_the_place_of_a_better_one():
    session = session_of(stack_of_plates())
    queries, rays = session.queries, session.ray_queries
    assert isinstance(rays, AxisRays)
    session.direction = "-z"
    session.hide(1)
    task = queries.occlusion_task()
    assert task is not None
    late = task.run(no_progress)
    session.show(1)
    known = queries.occlusion()
    asked = rays.asked
    assert not queries.store(task, late)
    assert queries.occlusion() is known
    assert rays.asked == asked


@pytest.mark.parametrize("rule", ["exact", "first_hit", "eq2"])
def test_what_a_window_asks_at_rest_spares_its_commands_the_rays(rule):
    session = session_of(stack_of_plates())
    queries, rays = session.queries, session.ray_queries
    assert isinstance(rays, AxisRays)
    session.direction, session.rule, queries.asks_at_rest = "-z", rule, True
    for plate in range(1, 6):
        task = queries.occlusion_task()
        if task is not None:
            assert queries.store(task, task.run(no_progress))
        asked = rays.asked
        assert session.unpack(1) == (plate,)
        assert rays.asked == asked


def test_labels_worked_out_ahead_are_not_kept_after_their_step():
    labels = stack_of_plates()
    session = Session(np.where(labels > 0, 1000.0, 0.0).astype(np.float32), labels)
    session.merge([1, 2])
    session.merge([3, 4])
    session.undo()
    session.undo()
    session.redo()
    queries = session.queries
    task = queries.labels_task("redo")
    assert task is not None
    assert queries.store(task, task.run(no_progress))
    assert queries.labels_task("redo") is None
    found = queries.labels_at(task.key.edit)
    assert found.revision == session.label_data.revision + 1
    assert queries.labels_task("redo") is not None


def test_a_result_within_a_tolerance_does_not_outlive_removals_by_other_rules():
    labels = np.zeros((10, 8, 8), np.uint16)
    labels[8, 1:7, 1:7] = 1
    labels[5, 1:7, 1:4] = 2
    labels[2, 1:7, 1:3] = 3
    session = session_of(labels)
    session.direction = "+z"
    session.tolerance = 0.4
    everything = session.queries.occlusion().packed
    session.tolerance = 0.0
    session.unpack(1)
    session.queries.occlusion(afresh=True)
    session.tolerance = 0.4
    assert session.queries.occlusion().packed == everything - {1}


def test_what_the_panel_is_told_is_what_a_fresh_question_says_whatever_was_done():
    made = nu.simulate_bag(seed=2, shape=(32, 36, 46), count=9)
    asked = reused = 0
    for seed in range(6, 10):
        rng = np.random.default_rng(seed)
        session = nu.Session(made.volume, made.labels, made.spacing, made.objects)
        session.backend = "cpu"
        session.direction = tuple(rng.normal(size=3))
        queries = session.queries
        for _ in range(10):
            one = int(rng.choice(session.ids))
            commands = [
                *[session.unpack] * 3,
                session.restore,
                session.undo,
                session.show,
                partial(session.hide, one),
                partial(session.inspect, one),
            ]
            commands[rng.integers(len(commands))]()
            # As the viewer does while nothing moves.
            task = queries.occlusion_task(finer=True)
            if task is not None:
                queries.store(task, task.run(no_progress))
                asked += 1
            if not queries.packed:
                continue
            told = set(queries.unpackable_groups())
            fresh = nu.Session(made.volume, made.labels, made.spacing, made.objects)
            fresh.backend, fresh.direction = "cpu", session.direction
            fresh.hide(frozenset(fresh.ids) - queries.packed)
            assert told == set(
                fresh.queries.occlusion().groups(queries.packed, session.rules.max_group_size)
            )
            reused += task is None
    # Not by asking at every step.
    assert reused > asked
