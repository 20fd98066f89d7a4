"""The next to leave, found before the whole result is there: the same one, and truly free."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from bags import session_of, stack_of_plates
from sweep import free_by_sweep

import napari_unpack as nu
from napari_unpack.session.ray_queries import RenderingQueries
from napari_unpack.tasks import no_progress


@cache
def bag(seed: int) -> nu.simulation.Bag:
    return nu.simulate_bag(seed=seed, shape=(40, 44, 56), count=14)


def fresh(seed: int) -> nu.Session:
    made = bag(seed)
    session = nu.Session(made.volume, made.labels, made.spacing, made.objects)
    session.backend = "cpu"
    return session


def directions(count: int) -> list[tuple[float, ...]]:
    drawn = np.random.default_rng(11).normal(size=(count, 3))
    return [tuple(d) for d in drawn] + [(0.0, -1.0, 0.0), (1.0, 0.0, 0.0)]


class NoRays(RenderingQueries):
    """Moves voxels; casts no rays."""

    def occlusion_counts(self, *_):
        raise AssertionError("rays were cast")

    sweep_table = occlusion_counts


def without_rays(session: nu.Session) -> nu.Session:
    """Return a session alike, in which what asks for the whole result fails."""
    rays = NoRays(session.labels, session.spacing)
    return nu.Session.of_parts(
        session.volume, session.spacing, session.label_data, session.state, session.view_state,
        session.rules, rays,
    )  # fmt: skip


def looked(session: nu.Session, n_or_ids) -> bool:
    """Find just enough for a command, and keep it."""
    task = session.queries.next_unpackable_task(n_or_ids)
    return session.queries.store(task, task.run(no_progress))


@pytest.mark.parametrize("seed", range(4))
def test_the_first_found_is_the_first_of_the_whole_answer_and_free(seed) -> None:
    compared = 0
    for direction in directions(6):
        session = fresh(seed)
        session.direction = direction
        session.unpackable()
        session.unpack(2)
        session.direction = tuple(-v for v in direction)
        task = session.queries.next_unpackable_task(1)
        quick = task.run(no_progress)
        whole = session.unpackable()
        if session.queue.least_occluded:
            assert quick is None
            continue
        compared += 1
        assert quick.groups[0] == session.queue.groups[0]
        packed = [i for i in whole if session.states[i].name == "PACKED"]
        assert packed
        if len(quick.groups[0]) == 1:
            there = np.where(
                np.isin(session.labels, list(task.key.occlusion.packed)), session.labels, 0
            )
            assert quick.groups[0][0] in free_by_sweep(
                there, session.unpack_direction, session.spacing
            )
    assert compared >= 4


def test_who_is_found_leaves_and_no_ray_is_cast() -> None:
    slow, quick = fresh(1), fresh(1)
    for session in (slow, quick):
        session.direction = (0.3, -1.0, 0.2)
    left = slow.unpack(3)
    quick = without_rays(quick)
    assert looked(quick, 3)
    assert quick.unpack(3) == left
    assert [entry.event for entry in quick.log] == ["query run", "queue reuse", "queue reuse"][
        : len(quick.log)
    ]
    quick.undo()
    assert quick.steps == ()


def test_chosen_objects_that_are_free_leave_and_no_ray_is_cast() -> None:
    slow, quick = fresh(2), fresh(2)
    for session in (slow, quick):
        session.direction = "-y"
    slow.unpackable()
    free = [i for (i,) in (g for g in slow.queries.unpackable_groups() if len(g) == 1)][:2]
    held = next(i for i in slow.ids if i not in slow.unpackable())
    quick = without_rays(quick)
    assert not looked(quick, [held])
    assert looked(quick, free)
    assert quick.unpack(free) == slow.unpack(free) == tuple(sorted(free))


def test_a_restored_object_is_asked_about_first_and_the_other_wishes_stay() -> None:
    session = fresh(1)
    session.direction = "-y"
    first, second = session.unpack(1), session.unpack(1)
    session.restore(second)
    session.restore(first)
    wishes = session.queue.restored
    assert set(wishes) == {*first, *second}
    session.direction = (0.01, -1.0, 0.0)
    assert looked(session, 1)
    left = session.unpack(1)
    assert left[0] in first
    assert session.queue.restored == tuple(i for i in wishes if i not in left)
    assert set(session.unpack(1)) <= {*first, *second}


def test_a_result_for_another_direction_bag_or_rule_is_refused() -> None:
    session = fresh(1)
    session.direction = "-y"
    task = session.queries.next_unpackable_task(1)
    found = task.run(no_progress)
    session.direction = "+y"
    assert not session.queries.store(task, found)
    session.direction = "-y"
    session.hide([session.ids[0]])
    assert not session.queries.store(task, found)
    session.show([session.ids[0]])
    session.max_group_size = 2
    assert not session.queries.store(task, found)
    session.max_group_size = 4
    assert session.queries.store(task, found)


def test_there_is_none_where_it_would_not_be_the_answer() -> None:
    session = fresh(1)
    session.unpackable()
    assert session.queries.next_unpackable_task(1) is None
    session = fresh(1)
    session.rule = "first_hit"
    assert session.queries.next_unpackable_task(1) is None
    session = fresh(1)
    session.tolerance = 0.1
    assert session.queries.next_unpackable_task(1) is None
    assert session_of(stack_of_plates()).queries.next_unpackable_task(1) is None


def test_when_time_is_up_it_says_nothing() -> None:
    session = fresh(1)
    times = iter(np.arange(0.0, 100.0, 0.05))
    queries = session.queries
    task = queries.next_unpackable_task(len(session.ids), 0.12, lambda: next(times))
    assert task.run(no_progress) is None
    with pytest.raises(ValueError, match="objects of this session"):
        queries.next_unpackable_task([999])


def test_a_number_of_numpy_says_how_many_too() -> None:
    queries = fresh(0).queries
    key = queries.next_unpackable_task(np.int64(2)).key
    assert (key.chosen, key.count) == (None, 2)
    assert session_of(stack_of_plates()).queries.removal_plan(np.int64(2)).ids == (1, 2)


def test_what_ends_in_one_plane_leaves_in_the_order_of_ids_whatever_sums_leave():
    labels = np.zeros((4, 5, 8), np.uint8)
    labels[1, 1:4, 1:3], labels[1, 2:4, 5:7] = 2, 1
    session = nu.Session(labels * np.float32(100), labels, (0.7, 0.1, 0.33))
    session.direction = "+y"
    assert session.unpackable() == (1, 2)
