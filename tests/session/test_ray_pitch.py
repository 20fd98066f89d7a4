"""Who is free is asked at the voxel pitch: no sheet of one voxel is passed over."""

from __future__ import annotations

import numpy as np
import pytest

import napari_unpack as nu

PITCHES = (0.1, 0.3, 0.55, 0.7, 0.8257, 0.9765625, 1.1)
AXES = [("-z", 0), ("-y", 1), ("-x", 2)]


def asked(labels: np.ndarray, spacing: tuple[float, float, float], direction: str) -> nu.Session:
    session = nu.Session(labels.astype(np.float32), labels, spacing)
    session.backend, session.direction = "cpu", direction
    return session


@pytest.mark.parametrize(("direction", "axis"), AXES)
def test_sheets_of_one_voxel_behind_each_other_all_block(direction: str, axis: int) -> None:
    # Sheet k of n lies at index k; leaving towards smaller indices each blocks all behind it.
    for pitch in PITCHES:
        for n in range(2, 21):
            shape = [3, 3, 3]
            shape[axis] = n + 2
            labels = np.zeros(shape, np.uint16)
            np.moveaxis(labels, axis, 0)[1 : n + 1] = np.arange(1, n + 1)[:, None, None]
            found = asked(labels, (pitch,) * 3, direction).queries.occlusion()
            assert found.unpackable == {1}, (pitch, n)
            assert found.blocking.graph.number_of_edges() == n * (n - 1) // 2


@pytest.mark.parametrize(("direction", "axis"), AXES)
def test_bars_of_one_voxel_beside_each_other_are_all_seen_under_a_plate(
    direction: str, axis: int
) -> None:
    # The plate is 100; below it bars lie side by side along one axis, below them along the other.
    for pitch in PITCHES:
        for n in range(2, 21):
            flat = np.zeros((3, n, n), np.uint16)
            flat[0] = 100
            flat[1] = np.arange(1, n + 1)
            flat[2] = np.arange(n + 1, 2 * n + 1)[:, None]
            labels = np.ascontiguousarray(np.moveaxis(flat, 0, axis))
            found = asked(labels, (pitch,) * 3, direction).queries.occlusion()
            assert found.unpackable == {100}, (pitch, n)


def test_who_can_leave_does_not_hang_on_how_the_view_is_rolled() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(1, 9, (6, 6, 6)).repeat(4, 0).repeat(4, 1).repeat(4, 2)
    found = []
    for up in ((0.0, -1.0, 0.0), (1.0, -0.6, 0.0)):
        session = asked(labels.astype(np.uint16), (1.0, 1.0, 1.0), "view")
        session.view = nu.View((0.5, 0.3, -0.8), up=up)
        found.append(session.queries.occlusion().first_hit)
    assert found[0] == found[1]
