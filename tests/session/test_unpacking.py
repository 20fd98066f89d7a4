from __future__ import annotations

import numpy as np
import pytest
from bags import AxisRays, hooked, session_of, stack_of_plates

from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import View
from napari_unpack.session import BlockedError, NobodyFreeError, ObjectState, Session
from napari_unpack.tasks import no_progress


def states(session, *ids):
    return [session.states[i].name for i in ids]


def rays_of(session) -> AxisRays:
    return session.ray_queries


def test_objects_leave_from_the_front_towards_the_viewer_one_by_one():
    session = session_of(stack_of_plates())
    assert session.unpackable() == (1,)
    assert [session.unpack() for _ in range(5)] == [(1,), (2,), (3,), (4,), (5,)]
    assert set(session.states.values()) == {ObjectState.UNPACKED}
    assert session.unpack() == ()


def test_from_the_other_side_they_leave_in_the_other_order():
    session = session_of(stack_of_plates())
    session.view = View(direction=(-1.0, 0.0, 0.0))
    assert session.unpack(3) == (5, 4, 3)


def test_the_queue_is_asked_once_for_a_direction_and_again_when_it_changes():
    session = session_of(stack_of_plates())
    session.unpack(2)
    session.unpack(1)
    assert rays_of(session).asked == 1
    session.view = View(direction=(-1.0, 0.0, 0.0))
    session.unpack()
    assert rays_of(session).asked == 2
    assert [entry.event for entry in session.log] == [
        "query run",
        "queue reuse",
        "queue reuse",
        "query run",
    ]
    assert [entry.packed for entry in session.log] == [5, 4, 3, 2]


def test_a_direction_of_ones_own_is_kept_while_the_view_turns():
    session = session_of(stack_of_plates())
    session.direction = "+z"
    assert session.direction == (1.0, 0.0, 0.0)
    assert session.unpackable() == (5,)
    session.view = View(direction=(0.0, 0.0, 1.0))
    assert session.unpackable() == (5,)
    session.direction = None
    assert set(session.unpackable()) == {1, 2, 3, 4, 5}
    with pytest.raises(ValueError, match="direction must be one of"):
        session.direction = "sideways"


def test_up_of_the_bag_is_a_direction():
    # The stack is 14 long along z, 6 along x and 4 along y: its largest faces look along y.
    session = session_of(stack_of_plates())
    session.direction = "up"
    np.testing.assert_allclose(session.unpack_direction, [0, -1, 0], atol=1e-3)
    assert session.direction == "up"


def test_restored_objects_leave_first_in_the_order_that_lets_them():
    session = session_of(stack_of_plates())
    session.unpack(3)
    assert session.restore(2) == (3, 2)
    assert states(session, 1, 2, 3) == ["UNPACKED", "PACKED", "PACKED"]
    assert session.unpack(2) == (2, 3)


def test_a_restored_object_is_checked_before_it_leaves_again():
    session = session_of(stack_of_plates())
    session.unpack(3)
    session.restore([3])
    session.restore([1])
    session.restore([2])
    # 2 was restored last, so it is at the head, but 1 stands in front of it now.
    assert session.unpackable() == (1,)


def test_restoring_a_chosen_object_leaves_the_others_out():
    session = session_of(stack_of_plates())
    session.unpack(3)
    assert session.restore([1]) == (1,)
    assert states(session, 1, 2, 3) == ["PACKED", "UNPACKED", "UNPACKED"]
    assert session.restore([1]) == ()


def test_chosen_objects_leave_together_with_what_they_stand_behind_if_that_is_chosen_too():
    session = session_of(stack_of_plates())
    assert session.unpack([3, 1, 2]) == (1, 2, 3)
    with pytest.raises(BlockedError, match=r"Object 5 cannot leave.*before Object 4"):
        session.unpack([5])
    assert states(session, 4, 5) == ["PACKED", "PACKED"]


def test_reveal_takes_out_just_what_is_in_the_way():
    labels = stack_of_plates()
    labels[:, :, 7] = 0
    labels[1:3, 1:5, 7] = 6  # beside plate 1, in front of nobody
    session = session_of(labels)
    assert session.reveal(3) == (1, 2, 3)
    assert states(session, 4, 5, 6) == ["PACKED"] * 3
    with pytest.raises(ValueError, match="3 is not in the bag: put it back"):
        session.reveal(3)


def test_objects_that_hold_each_other_leave_and_return_together():
    session = session_of(hooked())
    assert session.unpack() == (1, 2)
    assert session.restore() == (2, 1)
    assert session.unpack([2]) == (1, 2)
    assert session.restore([1]) == (2, 1)


def test_a_knot_that_is_too_large_counts_as_nobody_free():
    session = session_of(hooked())
    session.max_group_size = 1
    told: list[str] = []
    session.events.message.connect(told.append)
    # By first hit 1 has 8 rays in front and 8 behind 2, 2 has 8 of 16 behind 1: 0.5 each.
    assert session.unpack() == (1,)
    assert told == []
    session.undo()
    session.take_least_occluded = False
    with pytest.raises(NobodyFreeError, match=r"Object 1 is the least occluded \(50 % occluded\)"):
        session.unpack()
    assert session.unpackable() == ()
    assert states(session, 1, 2, 3) == ["PACKED"] * 3
    assert issubclass(NobodyFreeError, ValueError)


def test_hidden_objects_block_nobody_and_shown_ones_do_again():
    session = session_of(stack_of_plates())
    session.hide([1, 2])
    assert session.unpackable() == (3,)
    session.show([2])
    assert session.unpackable() == (2,)
    session.show()
    assert session.unpackable() == (1,)


def test_flying_objects_neither_block_nor_leave_again():
    session = session_of(stack_of_plates())
    session.animated = True
    session.unpack()
    assert states(session, 1, 2) == ["FLYING_OUT", "PACKED"]
    assert session.unpack() == (2,)
    assert list(session.flights) == [1, 2]
    session.land(1)
    assert states(session, 1, 2) == ["UNPACKED", "FLYING_OUT"]
    assert set(session.poses) == {1}
    session.land(2)
    session.land(2)
    assert session.flights == {}


def test_what_flies_lands_when_flights_are_switched_off():
    session = session_of(stack_of_plates(), clock=lambda: 0.0)
    session.animated = True
    session.unpack(2)
    session.land(1)
    session.restore([1])
    heard = []
    session.events.states.connect(heard.append)
    session.animated = False
    assert states(session, 1, 2) == ["PACKED", "UNPACKED"]
    assert session.flights == {}
    assert frozenset().union(*heard) == {1, 2}


def test_an_object_on_its_way_back_leads_the_queue_and_turns_round():
    clock = [0.0]
    session = session_of(stack_of_plates(), clock=lambda: clock[0])
    session.animated = True
    session.unpack(2)
    session.land(1)
    session.land(2)
    session.restore()
    clock[0] = 0.3
    assert states(session, 2) == ["FLYING_BACK"]
    before = session.flights[2].pose(0.3, session.camera)
    assert session.unpackable() == (2,)
    session.unpack()
    assert states(session, 2) == ["FLYING_OUT"]
    after = session.flights[2].pose(0.3, session.camera)
    np.testing.assert_allclose(after.center, before.center, atol=1e-6)


def test_a_flight_ends_in_the_slot_and_starts_where_the_object_was():
    session = session_of(stack_of_plates())
    session.animated = True
    session.unpack()
    flight = session.flights[1]
    packed = flight.pose(flight.start, session.camera)
    # The plate's box centre is voxel (1.5, 2.5, 3.5); the volume's middle is (7.5, 2.5, 3.5).
    np.testing.assert_allclose(packed.center, [6.0, 0.0, 0.0], atol=1e-9)
    end = flight.pose(flight.start + flight.seconds, session.camera)
    session.land(1)
    np.testing.assert_allclose(end.center, session.poses[1].center)
    np.testing.assert_allclose(end.rotation, session.poses[1].rotation, atol=1e-12)


def test_groups_of_one_command_follow_each_other_and_members_go_side_by_side():
    session = session_of(hooked(), clock=lambda: 5.0)
    session.animated = True
    session.unpack(3)
    one, two, three = (session.flights[i] for i in (1, 2, 3))
    assert one.start == two.start == 5.0 < three.start
    assert one.clear == two.clear
    np.testing.assert_allclose(
        one.pose_at(0.2, session.camera).center - one.pose_at(0, session.camera).center,
        two.pose_at(0.2, session.camera).center - two.pose_at(0, session.camera).center,
    )


def test_every_object_has_a_slot_of_its_own_and_keeps_it():
    session = session_of(stack_of_plates())
    session.unpack(3)
    poses = {i: tuple(pose.center) for i, pose in session.poses.items()}
    assert len(set(poses.values())) == 3
    session.unpack(1)
    assert {i: tuple(session.poses[i].center) for i in poses} == poses
    session.restore([2])
    session.unpack([2])
    assert tuple(session.poses[2].center) == poses[2]


def test_a_window_of_another_shape_rearranges_what_waits():
    session = session_of(stack_of_plates())
    session.unpack(2)
    heard: list[frozenset[int]] = []
    before = session.poses[1].center
    session.events.states.connect(heard.append)
    session.canvas_size = (500, 1500)
    assert heard == [frozenset({1, 2})]
    assert not np.allclose(session.poses[1].center, before)
    session.canvas_size = (500, 1500)
    assert len(heard) == 1
    with pytest.raises(ValueError, match="canvas_size"):
        session.canvas_size = (0, 100)


def test_inspection_takes_one_object_aside_and_leaving_puts_it_where_it_was():
    session = session_of(stack_of_plates())
    session.unpack(2)
    session.inspect(2)
    assert states(session, 1, 2) == ["UNPACKED", "INSPECTED"]
    session.inspect(1)
    assert states(session, 1, 2) == ["INSPECTED", "UNPACKED"]
    session.leave()
    session.leave()
    assert states(session, 1, 2) == ["UNPACKED", "UNPACKED"]
    session.inspect(4)
    session.leave()
    assert states(session, 4) == ["PACKED"]
    session.hide([4])
    with pytest.raises(ValueError, match="is hidden: show it first"):
        session.inspect(4)


def test_what_is_looked_at_alone_still_stands_before_the_next():
    # Plate 1 goes back before plate 2, so 2 is not free while 1 is looked at.
    session = session_of(stack_of_plates(3))
    session.inspect(1)
    assert session.unpackable() == (1,)
    with pytest.raises(BlockedError, match="Object 2 cannot leave"):
        session.unpack([2])
    session.leave()
    assert session.unpackable() == (1,)
    session.inspect(1)
    # Unpacking ends the inspection: 1 is in the bag and leaves first.
    assert session.unpack() == (1,)
    assert session.states[1] is ObjectState.UNPACKED


def test_an_object_put_somewhere_by_hand_stays_there():
    session = session_of(stack_of_plates())
    session.unpack()
    there = Pose(np.array([0.0, 3.0, 4.0]), np.eye(3), 1.5)
    session.place(1, there)
    session.place(1, there)
    now = session.poses[1]
    assert (now.center == there.center).all()
    assert (now.rotation == there.rotation).all()
    assert now.scale == there.scale
    session.undo()
    assert session.poses[1] is not there
    with pytest.raises(ValueError, match="2 is not unpacked: unpack it"):
        session.place(2, there)


def test_the_overview_holds_the_bag_and_all_slots():
    session = session_of(stack_of_plates())
    camera = session.overview()
    np.testing.assert_allclose(camera.center, [7.5, 2.5, 3.5])
    np.testing.assert_allclose(camera.rotation, session.camera.rotation)
    pixels = camera.pixels(session.slots.centers, session.canvas_size)
    assert (pixels > 0).all()
    assert (pixels < np.array(session.canvas_size)).all()


def test_an_answer_found_elsewhere_is_taken_while_it_fits_and_dropped_when_stale():
    session = session_of(stack_of_plates())
    task = session.queries.occlusion_task()
    found = task.run(no_progress)
    session.view = View(direction=(-1.0, 0.0, 0.0))
    assert session.queries.store(task, found) is False
    session.view = View(direction=(1.0, 0.0, 0.0))
    heard: list[tuple[int, ...]] = []
    session.events.queue.connect(heard.append)
    assert session.queries.store(task, found) is True
    assert heard == [(1,)]
    assert session.queries.occlusion_task() is None
    assert session.unpack() == (1,)
    assert rays_of(session).asked == 1


@pytest.mark.parametrize("n_or_ids", [0, -1, [9], [0]])
def test_a_bad_number_or_id_is_refused_and_nothing_changes(n_or_ids):
    session = session_of(stack_of_plates())
    session.unpack(2)
    for verb in (session.unpack, session.restore):
        with pytest.raises(ValueError, match="n_or_ids"):
            verb(n_or_ids)
    assert states(session, 1, 2, 3) == ["UNPACKED", "UNPACKED", "PACKED"]
    with pytest.raises(TypeError, match="n_or_ids must be object IDs"):
        session.unpack(["1"])


def test_what_is_blocked_within_the_tolerance_leaves_before_its_blocker():
    labels = np.zeros((10, 8, 8), np.uint16)
    labels[8, 1:7, 1:3] = 1
    # A third of it, two of its six columns, is behind 1.
    labels[5, 1:7, 1:7] = 2
    session = session_of(labels)
    session.direction = "+z"
    session.tolerance = 0.3
    assert session.unpackable() == (1,)
    session.tolerance = 0.4
    assert session.unpackable() == (1, 2)
    assert session.unpack([2]) == (2,)


def test_without_a_table_of_blockers_free_objects_leave_and_others_are_refused():
    labels = stack_of_plates()

    class NoTable(AxisRays):
        def occlusion_counts(self, *arguments):
            from dataclasses import replace

            return replace(super().occlusion_counts(*arguments), blocks=None)

    session = Session(labels.astype(float), labels, casters=NoTable(labels))
    session.view = View(direction=(1.0, 0.0, 0.0))
    with pytest.raises(BlockedError, match="Object 3 cannot leave"):
        session.unpack([3])
    assert session.unpack(2) == (1, 2)
    assert session.unpack([3]) == (3,)
    with pytest.raises(ValueError, match="which objects block which"):
        session.reveal(5)


def test_the_real_ray_caster_gives_the_same_order():
    labels = stack_of_plates()
    session = Session(labels.astype(float), labels, spacing=(2.0, 1.0, 1.5))
    session.backend = "cpu"
    session.view = View(direction=(0.9, 0.05, 0.1))
    assert session.unpack(5) == (1, 2, 3, 4, 5)
    session.restore(5)
    assert set(session.recolor()) == {1, 2, 3, 4, 5}


def test_where_fewer_can_leave_than_were_asked_for_the_queue_is_the_one_they_left():
    session = session_of(hooked())
    session.direction = "+z"
    session.max_group_size, session.take_least_occluded = 1, False
    assert session.unpack(3) == (3,)
    assert (session.queue.ids, session.queue.packed) == ((), {1, 2, 3})


def two_hooked_pairs() -> np.ndarray:
    """Bars that hook into each other along z, 1 into 2 and 3 into 4: none alone is free."""
    labels = np.zeros((12, 12, 12), np.uint16)
    for y, (a, b) in {0: (1, 2), 6: (3, 4)}.items():
        labels[8, y : y + 4, :5] = labels[2, y : y + 4, 5:10] = labels[2:9, y, 4:6] = a
        labels[4, y + 1 : y + 4, :5] = labels[6, y + 1 : y + 4, 5:10] = b
        labels[4:7, y + 3, 4:6] = b
    return labels


def real_session(labels: np.ndarray) -> Session:
    session = Session(np.where(labels > 0, 1000.0, 0.0), labels)
    session.backend = "cpu"
    return session


@pytest.mark.parametrize("way", ["hide", "force_unpack", "reveal"])
def test_the_least_occluded_stays_once_another_has_become_free(way):
    session = real_session(two_hooked_pairs())
    session.direction, session.max_group_size = "+z", 1
    assert session.unpackable() == (1,)
    assert session.queue.least_occluded
    session.reveal(3, "any") if way == "reveal" else getattr(session, way)(3)
    # What held it is gone.
    assert session.unpackable() == (4,)
    assert session.unpack() == (4,)
    assert session.log[-1].ratio == 0


@pytest.mark.parametrize("window", [False, True])
def test_what_can_leave_does_not_depend_on_what_was_asked_before(window):
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[3, 4:7, 2], labels[1:4, 5:8, 3], labels[5:7, 5:7, 2:4] = 1, 2, 3

    def bag(*hidden: int) -> Session:
        session = real_session(labels)
        session.direction, session.queries.asks_at_rest = (1, 1, 1), window
        session.hide(hidden)
        return session

    # By rays 2 holds 1 at the corners of its voxels; moved, 1 meets 3 alone.
    assert 1 in bag(3).unpackable()
    for verb in (lambda s: s.unpack([1]), lambda s: s.reveal(1)):
        session = bag()
        assert session.unpack(1) == (3,)
        assert verb(session) == (1,)


@pytest.mark.parametrize("window", [False, True])
def test_chosen_blockers_leave_before_what_they_block_by_every_rule(window):
    labels = np.zeros((10, 10, 10), np.uint16)
    labels[2, 3:6, 3:6], labels[5, 3:6, 3:6], labels[7, 3:6, 3:6] = 1, 2, 3
    for rule in ("exact", "first_hit"):
        session = real_session(labels)
        session.direction, session.rule = "+z", rule
        session.queries.asks_at_rest = window
        with pytest.raises(BlockedError, match="cannot leave"):
            session.unpack([1, 3])
        assert session.unpack([2, 3]) == (3, 2)
        session.undo()
        assert [session.unpack([i]) for i in (3, 2)] == [(3,), (2,)]
    hooks = real_session(two_hooked_pairs()[:, :6])
    hooks.direction, hooks.rule, hooks.max_group_size = "+z", "first_hit", 1
    # What the queue proposes for want of anything free can be chosen as well.
    assert hooks.unpack(list(hooks.unpackable())) == (1,)


def test_restored_in_the_air_all_go_on_from_where_they_are():
    labels = np.zeros((40, 40, 40), np.uint16)
    for k in range(16):
        z, x = 10 * (k // 4), 10 * (k % 4)
        labels[z + 1 : z + 8, 10:25, x + 1 : x + 8] = k + 1
    session, now = real_session(labels), [0.0]
    session.clock, session.animated, session.direction = lambda: now[0], True, "-y"
    session.view = View((0.5, 0.75, 0.3))
    session.unpack(4)
    now[0] = 1.0
    # The fifth has slots planned anew, to which the four turn.
    session.unpack(1)
    now[0] = 1.2

    def places() -> dict[int, np.ndarray]:
        return {i: f.pose(now[0], session.camera).center for i, f in session.flights.items()}

    before = places()
    session.restore(5)
    assert places().keys() == before.keys() == {1, 2, 3, 4, 5}
    for i, place in places().items():
        np.testing.assert_allclose(place, before[i], atol=1e-9)
    now[0] = 100.0
    packed = [session.boxes.center(i, session.spacing) for i in before]
    for place, center in zip(places().values(), packed, strict=True):
        np.testing.assert_allclose(
            place, session.camera.linear @ (center - session.camera.center), atol=1e-6
        )


def nearly_free_once_the_plate_has_left() -> Session:
    """Return a bag, seen along z: 2 holds 1 by one voxel in a hundred, and plate 3 by half."""
    labels = np.zeros((8, 12, 10), np.uint16)
    labels[2, :10], labels[0], labels[5, :5] = 1, 2, 3
    # Over the edge of 1, which lies on it: they hold each other.
    labels[:4, 11, 0] = labels[3, 9:, 0] = 2
    session = real_session(labels)
    session.direction, session.tolerance, session.queries.asks_at_rest = "+z", 0.02, True
    assert session.unpack(1) == (3,)
    return session


def told_at_rest(session: Session) -> None:
    """Store what a window finds out as soon as nothing moves."""
    task = session.queries.occlusion_task(finer=True)
    assert task is not None
    assert session.queries.store(task, task.run(no_progress))


def test_one_object_leaves_where_the_panel_says_that_one_can():
    session = nearly_free_once_the_plate_has_left()
    # So far only what was found with the plate in the bag, by which both leave together.
    assert session.queue.groups in [(), ((1, 2),)]
    assert session.unpackable() == (1, 2)
    told_at_rest(session)
    assert session.queries.unpackable_groups() == ((1,),)
    assert session.queue.groups == ((1,),)
    assert session.unpack(1) == (1,)
    session.undo()
    assert states(session, 1, 2, 3) == ["PACKED", "PACKED", "UNPACKED"]
    assert session.unpackable() == (1,)


def test_what_is_known_better_leaves_restored_objects_at_the_head():
    labels = np.zeros((8, 12, 24), np.uint16)
    # The bag above, beside it two plates of which nobody stands in the way.
    labels[2, :10, :10], labels[0, :, :10], labels[5, :5, :10] = 1, 2, 3
    labels[:4, 11, 0] = labels[3, 9:, 0] = 2
    labels[6, :4, 12:16], labels[1, :4, 18:22] = 4, 5
    session = real_session(labels)
    session.direction, session.tolerance, session.queries.asks_at_rest = "+z", 0.02, True
    session.unpack([3, 4, 5])
    session.restore([5])
    assert session.unpackable()[0] == 5
    told_at_rest(session)
    assert session.queue.groups == ((5,), (1,))
