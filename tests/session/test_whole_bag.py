"""A whole simulated bag with the real ray caster: out, back, and through history end to end."""

from __future__ import annotations

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.session import NobodyFreeError, ObjectState


@pytest.fixture
def session() -> nu.Session:
    bag = nu.simulate_bag(seed=2, shape=(96, 120, 144), count=18)
    session = nu.Session(bag.volume, bag.labels, bag.spacing, bag.objects)
    session.backend = "cpu"
    return session


def picture(session: nu.Session) -> tuple:
    """All that undo has to bring back, comparable."""
    places = {
        i: (p.center.tolist(), p.rotation.tolist(), p.scale) for i, p in session.poses.items()
    }
    return dict(session.states), places, list(session.poses), session.packed_tints().tolist()


def test_everything_leaves_returns_and_history_runs_from_end_to_end(session) -> None:
    seen = [picture(session)]
    packed = set(session.ids)
    while packed:
        left = session.unpack()
        assert left
        assert packed.issuperset(left)
        packed.difference_update(left)
        seen.append(picture(session))
    assert set(session.states.values()) == {ObjectState.UNPACKED}
    centers = np.array([pose.center for pose in session.poses.values()])
    assert len(np.unique(centers.round(6), axis=0)) == len(session.ids) == 18

    assert sorted(session.restore(18)) == list(session.ids)
    assert set(session.states.values()) == {ObjectState.PACKED}
    assert session.poses == {}
    seen.append(picture(session))

    for wanted in reversed(seen[:-1]):
        assert session.undo()
        assert picture(session) == wanted
    assert session.undo() is None
    for wanted in seen[1:]:
        assert session.redo()
        assert picture(session) == wanted
    assert session.redo() is None


def test_nothing_leaves_behind_what_the_voxels_say_is_in_front(session) -> None:
    # Along -y with rays down the voxel columns: whoever leaves alone as free meets nothing on
    # the way, looked up voxel by voxel.
    session.direction = "-y"
    session.take_least_occluded = False
    labels = session.labels.copy()
    alone = 0
    for _ in range(8):
        try:
            left = session.unpack()
        except NobodyFreeError:
            break
        mine = np.isin(labels, left)
        # Voxels that have one of the group's at the same or a larger y stand in its way.
        before_it = np.cumsum(mine[:, ::-1], axis=1)[:, ::-1] > 0
        assert not ((labels > 0) & ~mine & before_it).any()
        labels[mine] = 0
        alone += 1
    assert alone >= 3
