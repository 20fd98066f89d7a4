"""Objects the transfer function hardly shows: alone they are seen all the same."""

from __future__ import annotations

import numpy as np

from napari_unpack import Session, TransferFunction
from napari_unpack.appearance.minimum_opacity import (
    GIVEN_OPACITY,
    HARDLY_SEEN,
    minimum_opacity,
    surely_seen,
)
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering.compose import sprite_image
from napari_unpack.rendering.object_style import ObjectStyle

FAINT_SHEET, SOLID = 1, 2
SHOWN = TransferFunction([(0, 0.0), (100, 0.0), (1000, 0.5)])


def bag() -> Session:
    volume, labels = np.zeros((2, 24, 24, 24), np.uint16)
    labels[4:6, 3:20, 3:20], labels[10:20, 4:18, 4:18] = FAINT_SHEET, SOLID
    volume[labels == FAINT_SHEET], volume[labels == SOLID] = 110, 900
    session = Session(volume, labels)
    session.backend = "cpu"
    session.transfer_function = SHOWN
    return session


def seen(session: Session, object_id: int) -> float:
    """Return the opacity in the middle of the object's sprite."""
    patch = sprite_image(session.scene(), object_id, Pose(np.zeros(3), np.eye(3)), 2.0, 1.0, "cpu")
    alpha = patch.rgba[..., 3]
    return float(np.median(alpha[alpha > 0])) if alpha.size else 0.0


def test_a_hardly_seen_object_leaves_with_a_minimum_opacity_and_nothing_else_changes() -> None:
    session = bag()
    assert session.transfer_function_of(SOLID) is session.transfer_function
    assert seen(session, FAINT_SHEET) > 0.2
    assert session.transfer_function == SHOWN
    session.transfer_function = TransferFunction([(0, 0.0), (50, 0.3), (1000, 0.5)])
    assert session.transfer_function_of(FAINT_SHEET) is session.transfer_function


def test_an_opacity_of_its_own_is_left_alone() -> None:
    session = bag()
    session.set_style(FAINT_SHEET, ObjectStyle(SHOWN))
    assert session.transfer_function_of(FAINT_SHEET) == SHOWN
    assert seen(session, FAINT_SHEET) < 0.05


def test_the_minimum_opacity_gives_the_opacity_it_promises() -> None:
    mask = np.ones((3, 40, 40), bool)
    least = minimum_opacity(mask, np.full(mask.shape, 100.0), SHOWN)
    np.testing.assert_allclose(1 - (1 - least) ** 3, GIVEN_OPACITY, atol=1e-9)
    assert minimum_opacity(mask, np.full(mask.shape, 1000.0), SHOWN) == 0.0
    assert minimum_opacity(mask, np.full(mask.shape, np.nan), SHOWN) > 0.0


def test_objects_settled_by_their_facts_need_no_minimum_opacity() -> None:
    rng = np.random.default_rng(4)
    passed = 0
    for _ in range(300):
        mask = rng.random(rng.integers(1, 9, 3)) < rng.uniform(0.2, 1.0)
        mask.flat[0] = True
        level = rng.uniform(0, 1000)
        density = np.full(mask.shape, level)
        if surely_seen(int(mask.sum()), np.array(mask.shape), level, SHOWN):
            passed += 1
            assert minimum_opacity(mask, density, SHOWN) == 0.0
    assert passed > 50
    assert 0 < HARDLY_SEEN < GIVEN_OPACITY


def test_an_object_of_nan_alone_leaves_with_a_minimum_opacity() -> None:
    session = bag()
    volume = session.volume.astype(np.float32)
    volume[session.labels == SOLID] = np.nan
    unknown = Session(volume, session.labels)
    unknown.transfer_function = SHOWN
    tint = unknown.scene().tint_alone(SOLID)
    assert tint[3] == 1.0
    assert seen(unknown, SOLID) > 0.2


def test_air_is_what_lies_around_an_object_also_where_a_scan_is_padded() -> None:
    session = bag()
    volume = session.volume.astype(np.int16) - 1000
    volume[0] = -3024
    padded = Session(volume, session.labels)
    for first in (-3024, 0):
        padded.transfer_function = TransferFunction([(first, 0.0), (100, 0.0), (1000, 0.5)])
        raised = padded.transfer_function_of(FAINT_SHEET)
        assert raised.opacity_at(-890) > 0.1
        assert raised.opacity_at(-1000) == 0


def test_a_minimum_opacity_leaves_the_air_around_an_object_clear() -> None:
    session = bag()
    raised = session.transfer_function_of(FAINT_SHEET)
    assert raised.opacity_at(110) > 0.1
    assert raised.opacity_at(0) == 0
    # Two voxels of air around it are drawn with it: they would be a shell.
    patch = sprite_image(
        session.scene(), FAINT_SHEET, Pose(np.zeros(3), np.eye(3)), 1.0, 1.0, "cpu"
    )
    rows, columns = (patch.rgba[..., 3] > 0.05).any(axis=1), (patch.rgba[..., 3] > 0.05).any(axis=0)
    # Seen along z it has 17 x 17 voxels, and half a voxel of soft edge on every side.
    assert rows.sum() <= 19
    assert columns.sum() <= 19
