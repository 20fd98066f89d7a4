from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bags import session_of, stack_of_plates
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.geometry.view import View
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session import ObjectState

ONE = st.integers(1, 5)
SOME = st.lists(ONE, min_size=1, max_size=3)


def names(session):
    return {i: state.name for i, state in session.states.items()}


def test_undo_takes_steps_back_in_turn_and_redo_does_them_again():
    session = session_of(stack_of_plates())
    seen = [names(session)]
    for verb in (
        lambda: session.unpack(2),
        lambda: session.hide([5]),
        lambda: session.restore([1]),
        lambda: session.isolate([3]),
    ):
        verb()
        seen.append(names(session))
    poses = dict(session.poses)
    for earlier in reversed(seen[:-1]):
        assert session.undo() is not None
        assert names(session) == earlier
    assert session.undo() is None
    for later in seen[1:]:
        session.redo()
        assert names(session) == later
    assert session.redo() is None
    for i, pose in poses.items():
        np.testing.assert_array_equal(session.poses[i].center, pose.center)


def test_a_new_command_ends_the_possibility_to_redo():
    session = session_of(stack_of_plates())
    session.unpack()
    session.undo()
    session.hide([2])
    assert session.redo() is None
    assert names(session)[1] == "PACKED"


NOTHING = {
    "name": lambda s: s.rename(3, " Object 3 "),
    "names": lambda s: s.annotations.name_and_color({3: "Object  3"}, {}),
    "transfer function": lambda s: setattr(s, "transfer_function", s.transfer_function),
    "no style": lambda s: s.set_style(3, None),
}


@pytest.mark.parametrize("what", NOTHING)
def test_a_command_that_changes_nothing_is_no_step_and_redo_stays_possible(what):
    session = session_of(stack_of_plates())
    session.unpack()
    session.undo()
    NOTHING[what](session)
    assert session.history.done == ()
    assert session.state.names == {}
    assert session.redo() == "unpack"
    assert names(session)[1] == "UNPACKED"


ALREADY_SO = {
    "placed in its slot": lambda s: s.place(1, s.poses[1]),
    "held as it left": lambda s: s.turn(1, s.poses[1].rotation.copy()),
    "placed by hand": lambda s: s.place(2, replace(s.poses[2], center=s.poses[2].center + 1e-9)),
    "turned by hand": lambda s: s.turn(2, s.poses[2].rotation),
}


@pytest.mark.parametrize("what", ALREADY_SO)
def test_what_is_put_where_it_is_or_held_as_it_is_is_no_step(what):
    session = session_of(stack_of_plates())
    session.unpack(2)
    session.place(2, replace(session.poses[2], center=session.poses[2].center + 5.0))
    session.turn(2, rotation_about((1, 0, 0), 0.5) @ session.poses[2].rotation)
    session.hide([5])
    session.undo()
    before = session.state.placements
    ALREADY_SO[what](session)
    assert [step.verb for step in session.history.done] == ["unpack", "move 2"]
    assert session.state.placements is before
    assert session.redo() == "hide"


def test_what_is_drawn_there_and_back_is_no_step():
    session = session_of(stack_of_plates())
    session.unpack()
    was = session.transfer_function
    for scale in (2, 3):
        points = [(density, opacity / scale) for density, opacity in was.points]
        session.transfer_function = replace(was, points=points)
    session.transfer_function = replace(was)
    assert [step.verb for step in session.history.done] == ["unpack"]


def test_undoing_a_step_leaves_alone_what_it_did_not_change():
    session = session_of(stack_of_plates())
    session.hide([2])
    session.apply_hues({3: 0.123}, undoable=False)
    session.undo()
    assert names(session)[2] == "PACKED"
    assert session.hues[3] == 0.123


def test_undo_of_hues():
    session = session_of(stack_of_plates())
    before = session.hues
    session.recolor()
    session.undo()
    assert session.hues == before


def test_undoing_an_unpacking_flies_it_back_when_animated():
    session = session_of(stack_of_plates(), clock=lambda: 0.0)
    session.animated = True
    session.unpack(2)
    session.land(1)
    session.undo()
    assert (names(session)[1], names(session)[2]) == ("FLYING_BACK", "FLYING_BACK")
    session.redo()
    assert (names(session)[1], names(session)[2]) == ("FLYING_OUT", "FLYING_OUT")
    session.land(1)
    session.land(2)
    assert (names(session)[1], names(session)[2]) == ("UNPACKED", "UNPACKED")


def test_the_queue_is_the_one_of_then():
    session = session_of(stack_of_plates())
    session.unpack(2)
    session.undo()
    assert session.unpackable() == (1,)


def test_looking_at_an_object_is_no_step_and_undo_ends_it():
    session = session_of(stack_of_plates())
    session.unpack(1)
    session.inspect(1)
    session.leave()
    session.inspect(1)
    assert session.undo() == "unpack"
    assert set(names(session).values()) == {"PACKED"}
    assert session.undo() is None
    session.inspect(3)
    assert session.redo() == "unpack"
    assert names(session) == {1: "UNPACKED"} | dict.fromkeys((2, 3, 4, 5), "PACKED")


def test_what_changed_between_two_moves_is_not_taken_back_with_them():
    session = session_of(stack_of_plates())
    session.unpack(1)
    home = session.poses[1]
    session.place(1, replace(home, scale=2.0))
    session.apply_hues({4: 0.321}, undoable=False)
    session.place(1, replace(home, scale=3.0))
    assert session.undo() == "move 1"
    assert session.poses[1].scale == home.scale
    assert session.hues[4] == 0.321


class RandomCommands(RuleBasedStateMachine):
    """Any commands in any order, watched by a second bookkeeper."""

    @initialize(animated=st.booleans())
    def start(self, animated):
        self.time = 0.0
        self.session = session_of(stack_of_plates(), clock=lambda: self.time)
        self.session.animated = animated
        self.told = dict(self.session.states)
        self.session.events.states.connect(self.hear)

    def hear(self, ids):
        for i in ids:
            self.told[i] = self.session.states[i]

    @rule(n=st.integers(1, 3))
    def unpack(self, n):
        before = {i for i, s in self.session.states.items() if s is ObjectState.PACKED}
        left = self.session.unpack(n)
        assert len(left) >= min(n, len(before))
        # Plates leave from the front: nobody that stayed stands before one that left.
        inside = [i for i in before if i not in left]
        assert all(i > max(left) for i in inside) or not set(left) & before or self.sideways

    sideways = False

    @rule(ids=SOME)
    def unpack_these(self, ids):
        before = dict(self.session.states)
        try:
            self.session.unpack(ids)
        except ValueError:
            assert self.session.states == before

    @rule(n=st.integers(1, 3))
    def restore(self, n):
        self.session.restore(n)

    @rule(ids=SOME)
    def restore_these(self, ids):
        self.session.restore(ids)

    @rule(i=ONE)
    def reveal(self, i):
        before = dict(self.session.states)
        try:
            assert i in self.session.reveal(i)
        except ValueError:
            assert self.session.states == before

    @rule(ids=SOME)
    def hide(self, ids):
        self.session.hide(ids)

    @rule(ids=SOME)
    def show(self, ids):
        self.session.show(ids)

    @rule(ids=SOME)
    def isolate(self, ids):
        self.session.isolate(ids)

    @rule(i=ONE)
    def inspect(self, i):
        if self.session.states[i] is not ObjectState.HIDDEN:
            self.session.inspect(i)
            assert self.session.states[i] is ObjectState.INSPECTED

    @rule()
    def leave(self):
        self.session.leave()

    @rule(i=ONE, wait=st.floats(0, 1))
    def land(self, i, wait):
        self.time += wait
        self.session.land(i)

    @rule()
    def undo(self):
        before = dict(self.session.states)
        if self.session.undo() is None:
            assert self.session.states == before

    @rule()
    def redo(self):
        self.session.redo()

    @rule(direction=st.sampled_from([(1.0, 0, 0), (-1.0, 0, 0), (0, 0, 1.0)]))
    def turn(self, direction):
        self.session.view = View(direction=direction)
        self.sideways = direction != (1.0, 0, 0)

    @rule()
    def recolor(self):
        self.session.recolor()

    @invariant()
    def everything_agrees(self):
        session = self.session
        states = session.states
        assert set(states) == {1, 2, 3, 4, 5}
        assert states == self.told
        flying = {ObjectState.FLYING_OUT: False, ObjectState.FLYING_BACK: True}
        assert {i: f.back for i, f in session.flights.items()} == {
            i: flying[s] for i, s in states.items() if s in flying
        }
        assert {i for i, s in states.items() if s is ObjectState.UNPACKED} <= set(session.poses)
        assert set(session.poses) <= {
            i for i, s in states.items() if s in (ObjectState.UNPACKED, ObjectState.INSPECTED)
        }
        assert sum(s is ObjectState.INSPECTED for s in states.values()) <= 1
        shown = {int(i) for i in np.flatnonzero(session.packed_tints()[:, 3])}
        assert shown == {i for i, s in states.items() if s is ObjectState.PACKED}
        places = [tuple(pose.center) for pose in session.poses.values()]
        assert len(set(places)) == len(places)
        if not session.animated:
            assert session.flights == {}


TestRandomCommands = RandomCommands.TestCase
TestRandomCommands.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)


def test_a_step_that_cannot_be_taken_back_is_still_done():
    session = session_of(stack_of_plates())
    session.cutting.box = [[1] * 3, [3] * 3]
    session.cutting.box = None
    # As many planes of a script's own leave no room for the box's six.
    session.clipping = [[[k, 0, 0], [1, 0, 0]] for k in range(3)]
    done = [step.verb for step in session.history.done]
    with pytest.raises(ValueError, match="room for 8 clipping planes, and there would be 9: take"):
        session.undo()
    assert [step.verb for step in session.history.done] == done
    session.clipping = None
    assert session.undo() == done[-1]
    assert session.cutting.box is not None


def test_pictures_of_steps_are_mirrored_with_the_bag_whichever_way_one_comes_to_them():
    def away(session):
        return {i: at.rotation.tolist() for i, at in session.state.placements.items()}

    mirrored = []
    for before in ("both out", "one undone", "gone back to the start"):
        session = session_of(stack_of_plates())
        session.unpack(1)
        session.set_style(2, ObjectStyle(session.transfer_function))
        session.unpack(1)
        if before == "one undone":
            session.undo()
        elif before == "gone back to the start":
            session.go_to(0)
        session.look(replace(session.camera, stretch=-np.eye(3)))
        if before == "one undone":
            session.redo()
        elif before == "gone back to the start":
            session.go_to(2)
        mirrored.append(away(session))
        # And back again to one alone, whose picture is the mirrored one as well.
        session.undo() if before != "gone back to the start" else session.go_to(1)
        assert away(session) == {1: mirrored[0][1]}
    assert mirrored[0] == mirrored[1] == mirrored[2]
    assert mirrored[0].keys() == {1, 2}
    # A step that moves nothing leaves what has moved since alone.
    session = session_of(stack_of_plates())
    session.unpack(1)
    session.set_style(2, ObjectStyle(session.transfer_function))
    session.look(replace(session.camera, stretch=-np.eye(3)))
    before = session.state.placements
    session.undo()
    assert session.state.placements is before
