"""Any commands in any order, files and repairs included: nothing is lost, undo gives the start."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
from bags import stack_of_plates
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.geometry.view import View
from napari_unpack.io.session_json import given_labels, record_of, session_from
from napari_unpack.session import ObjectState, Session

PICK = st.integers(0, 9)
PICKS = st.lists(PICK, min_size=1, max_size=3)
WAYS = st.sampled_from([None, "up", "+z", "-x", (0.0, 1.0, 0.0)])
LOOKS = st.sampled_from([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
FLYING = {ObjectState.FLYING_OUT, ObjectState.FLYING_BACK}


def fingerprint(session):
    """Return what undo must bring back."""
    # Looking at an object alone is no step of undo.
    now = replace(session.state, inspected=None)
    return (
        {i: now.state(i) for i in session.ids},
        list(now.placements),
        [placement.slot for placement in now.placements.values()],
        session.hues,
        session.objects["name"].to_dict(),
        session.direction,
        now.transfer_function,
        session.labels.tobytes(),
    )


class AnyCommands(RuleBasedStateMachine):
    """A session, a second bookkeeper who hears what it tells, and any commands."""

    @initialize(animated=st.booleans())
    def begin(self, animated):
        labels = stack_of_plates(4)
        volume = np.where(labels > 0, 1000 + 10 * labels, 0).astype(np.float32)
        self.time = 0.0
        session = Session(volume, labels, clock=lambda: self.time)
        session.backend, session.animated = "cpu", animated
        session.view = View(direction=(1.0, 0.0, 0.0))
        self.take(session)

    def take(self, session):
        self.session, self.start = session, fingerprint(session)
        self.told = dict(session.states)
        self.volume = session.volume.tobytes()
        self.view, self.view_then = session.view, deepcopy(session.view)
        session.events.states.connect(self.hear)

    def hear(self, ids):
        for i in ids:
            if i in self.session.states:
                self.told[i] = self.session.states[i]

    def ids(self, picks):
        known = self.session.ids
        return list(dict.fromkeys(known[k % len(known)] for k in picks))

    def attempt(self, act):
        """Do what may be refused; a refusal changes nothing."""
        before = fingerprint(self.session)
        try:
            return act()
        except ValueError:
            assert fingerprint(self.session) == before
            return None

    @rule(n=st.integers(1, 3))
    def unpack(self, n):
        self.session.unpack(n)

    @rule(picks=PICKS)
    def unpack_these(self, picks):
        self.attempt(lambda: self.session.unpack(self.ids(picks)))

    @rule()
    def unpack_all_free(self):
        free = self.session.unpackable()
        if free and not self.session.queue.least_occluded:
            assert set(free) <= set(self.session.unpack(free))

    @rule(n=st.integers(1, 3))
    def restore(self, n):
        self.session.restore(n)

    @rule(picks=PICKS)
    def restore_these(self, picks):
        self.session.restore(self.ids(picks))

    @rule(pick=PICK)
    def reveal(self, pick):
        (i,) = self.ids([pick])
        left = self.attempt(lambda: self.session.reveal(i))
        assert left is None or i in left

    @rule(step=st.integers(0, 6))
    def scrub(self, step):
        reached = self.session.go_to(step)
        assert reached == self.session.step <= step

    @rule(picks=PICKS)
    def hide(self, picks):
        self.session.hide(self.ids(picks))

    @rule(picks=PICKS)
    def show(self, picks):
        self.session.show(self.ids(picks))

    @rule(picks=PICKS)
    def isolate(self, picks):
        self.session.isolate(self.ids(picks))

    @rule(pick=PICK)
    def inspect(self, pick):
        self.attempt(lambda: self.session.inspect(*self.ids([pick])))

    @rule()
    def leave(self):
        self.session.leave()

    @rule(direction=WAYS)
    def direct(self, direction):
        self.session.direction = direction

    @rule(direction=LOOKS)
    def look(self, direction):
        self.session.view = View(direction=direction)
        self.view, self.view_then = self.session.view, deepcopy(self.session.view)

    @rule()
    def recolor(self):
        self.session.recolor()

    @rule(pick=PICK, name=st.sampled_from(["a cup", "keys"]))
    def rename(self, pick, name):
        self.session.rename(*self.ids([pick]), name)

    @rule(tolerance=st.sampled_from([0.0, 0.4]))
    def tolerate(self, tolerance):
        self.session.tolerance = tolerance

    @rule(pick=PICK, wait=st.floats(0, 2))
    def land(self, pick, wait):
        self.time += wait
        self.session.land(*self.ids([pick]))

    @rule(pick=PICK, angle=st.floats(0.1, 3.0))
    def turn(self, pick, angle):
        turn = rotation_about((0.3, 1.0, 0.6), angle)
        self.attempt(lambda: self.session.turn(*self.ids([pick]), turn))

    @rule(pick=PICK)
    def force_unpack(self, pick):
        self.attempt(lambda: self.session.force_unpack(*self.ids([pick])))

    @rule(size=st.sampled_from([(300, 400), (900, 200), (60, 80)]))
    def resize(self, size):
        self.session.canvas_size = size

    @rule()
    def undo(self):
        self.session.undo()

    @rule()
    def redo(self):
        self.session.redo()

    @rule()
    def save_and_open(self):
        before = self.session
        record = json.loads(json.dumps(record_of(before), allow_nan=False))
        after = session_from(record, before.volume, given_labels(before))
        after.clock, after.backend = (lambda: self.time), "cpu"
        after.animated = before.animated
        assert fingerprint(after) == fingerprint(before)
        assert after.steps == before.steps
        self.take(after)

    @precondition(lambda self: len(self.session.ids) > 2)
    @rule(picks=st.lists(PICK, min_size=2, max_size=2))
    def merge(self, picks):
        self.attempt(lambda: self.session.merge(self.ids(picks)))

    @precondition(lambda self: len(self.session.ids) > 2)
    @rule(pick=PICK)
    def delete(self, pick):
        self.attempt(lambda: self.session.delete(self.ids([pick])))

    @precondition(lambda self: len(self.session.ids) < 8)
    @rule(pick=PICK)
    def split(self, pick):
        (i,) = self.ids([pick])
        voxels = np.argwhere(self.session.labels == i)
        if len(voxels) > 1:
            ends = tuple(map(int, voxels[0])), tuple(map(int, voxels[-1]))
            self.attempt(lambda: self.session.split(i, *ends))

    @invariant()
    def nothing_is_lost_and_every_object_is_in_one_state(self):
        session = self.session
        states = session.states
        assert tuple(states) == session.ids
        assert session.ids == tuple(int(i) for i in np.unique(session.labels) if i)
        assert {i: self.told[i] for i in states} == states
        assert all(isinstance(state, ObjectState) for state in states.values())
        packed = {i for i, s in states.items() if s is ObjectState.PACKED}
        assert {int(i) for i in np.flatnonzero(session.packed_tints()[:, 3])} == packed
        assert set(session.flights) == {i for i, s in states.items() if s in FLYING}
        assert {i for i, s in states.items() if s is ObjectState.UNPACKED} <= set(session.poses)
        assert not packed & set(session.poses)
        assert sum(s is ObjectState.INSPECTED for s in states.values()) <= 1
        done = [i for group in session.steps[: session.step] for i in group]
        assert sorted(done) == sorted(session.state.placements)
        assert len({b.slot for b in session.state.placements.values()}) == len(done)
        assert session.animated or not session.flights

    @invariant()
    def what_was_given_is_not_written_to(self):
        assert self.session.volume.tobytes() == self.volume
        assert self.view == self.view_then

    def teardown(self):
        if not hasattr(self, "session"):
            return
        self.session.leave()
        while self.session.undo() is not None:
            pass
        assert fingerprint(self.session) == self.start


TestAnyCommands = AnyCommands.TestCase
TestAnyCommands.settings = settings(
    max_examples=40,
    stateful_step_count=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
