from __future__ import annotations

from napari_unpack.unpacking import Queue

D = (0.0, 0.0, 1.0)
ALL = (2, 4, 5, 7, 9)


def filled() -> Queue:
    return Queue().refilled([(4,), (2, 9), (7,)], D, ALL, {4: 3.0, 2: 5.0, 9: 1.0, 7: 2.0})


def test_groups_stand_in_the_order_of_their_foremost_member():
    assert filled().groups == ((2, 9), (7,), (4,))
    assert filled().ids == (2, 9, 7, 4)


def test_a_queue_serves_its_own_direction_until_it_runs_dry():
    queue = filled()
    assert queue.serves(D, ALL)
    assert not queue.serves((0.0, 1.0, 0.0), ALL)
    assert not Queue().serves(D, ALL)
    assert not queue.without([2, 9, 7, 4]).serves(D, ALL)


def test_a_queue_serves_while_all_in_it_are_packed_and_nobody_has_come_into_the_bag():
    assert filled().serves(D, [2, 4, 7, 9])
    assert not filled().serves(D, [2, 4, 5, 7])
    assert not filled().serves(D, [*ALL, 6])


def test_a_group_that_loses_a_member_is_not_kept():
    assert filled().without([9]).groups == ((7,), (4,))


def test_restored_objects_come_first_in_the_order_of_restoring_after_a_new_question():
    queue = filled().without([2, 9]).put_back([9]).put_back([2])
    assert not queue.serves(D, ALL)
    again = queue.refilled([(4,), (7,), (9,), (2,)], D, ALL, {4: 0.0, 7: 1.0})
    assert again.groups == ((2,), (9,), (4,), (7,))
    assert again.serves(D, ALL)


def test_a_restored_object_that_is_blocked_now_does_not_stand_in_the_queue():
    queue = filled().put_back([5]).refilled([(7,)], D, ALL)
    assert queue.ids == (7,)
    assert queue.restored == ()


def test_without_a_rank_the_queue_goes_by_id():
    assert Queue().refilled([(9,), (1,), (5,)], D, ALL).ids == (1, 5, 9)


def test_a_queue_is_never_changed_only_replaced():
    queue = filled()
    queue.without([7])
    queue.put_back([3])
    assert queue == filled()


def test_the_least_occluded_is_that_only_while_all_that_were_packed_are():
    queue = Queue().refilled([(4,)], D, ALL, least_occluded=True)
    assert queue.serves(D, ALL)
    assert not queue.serves(D, (2, 4, 5, 7))
