"""The stage on layers that napari mirrors, stretches or shears: everything where napari has it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint

from both_backends import assert_alike, pictures_of_both
from mouse import move
from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.view import View
from napari_unpack.layers import compat
from napari_unpack.session import ObjectState, Session
from napari_unpack.viewer.controller import SessionController
from napari_unpack.viewer.linked_slices import LinkedSlices
from napari_unpack.viewer.split_tool import surface_voxel
from viewer_fixtures import canvas, complaints

pytestmark = pytest.mark.filterwarnings("ignore:Non-orthogonal slicing")
TILT = np.eye(4)
TILT[1, 0], TILT[:3, 3] = np.tan(np.radians(15)), (7, -30, 12)
PLACES: dict[str, dict[str, Any]] = {
    "mirrored": {"scale": (1.5, 1.5, -1.5), "translate": (0, 40, 90)},
    "sheared": {"scale": (1.5, 1.5, 1.5), "affine": TILT},
    "all of it": {"scale": (2.0, -1.0, 1.5), "shear": (0.3, 0.1, -0.2), "rotate": (9.0, 50.0, 7.0)},
}
OPAQUE = TransferFunction([(300, 0.0), (600, 1.0), (2000, 1.0)])


@pytest.fixture(params=list(PLACES))
def placed(request, make_napari_viewer_proxy, bag):
    """Return (viewer, stage, labels): the phantom on a layer that stands so, at rest."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(760, 560)
    place = PLACES[request.param]
    image = viewer.add_image(bag[0], **place)
    labels = viewer.add_labels(bag[1].astype(np.int32), **place)
    session = Session(*bag, spacing=(1.5, 1.5, 1.5))
    session.transfer_function = OPAQUE
    session.view = View((0.6, 0.55, 0.4))
    controller = SessionController(viewer, session, [image, labels])
    heard: list[str] = []
    controller.events.message.connect(heard.append)
    controller.seconds = 0.2
    controller.overlays.outlines_unpackable = controller.recolor_at_rest = False
    controller.open()
    yield viewer, controller, labels
    controller.close()
    assert heard == []
    assert complaints(viewer) == []


def naparis_pixels(viewer, layer, voxels: np.ndarray) -> np.ndarray:
    """Return (n, 2) row and column at which napari draws voxels of a layer."""
    visual = compat.unwrap(viewer).window._qt_viewer.canvas.layer_to_visual[compat.unwrap(layer)]
    # vispy's pixels count from the canvas's corner, ours from the middle of the first.
    found = visual.node.get_transform("visual", "canvas").map(voxels[:, ::-1])
    return found[:, 1::-1] / found[:, 3:] - 0.5


def seen(viewer, layers) -> np.ndarray:
    """Return (H, W) of bool: where these layers show something."""
    pictures = []
    before = [layer.visible for layer in viewer.layers]
    for visible in (True, False):
        for layer in viewer.layers:
            layer.visible = visible and compat.unwrap(layer) in [compat.unwrap(i) for i in layers]
        pictures.append(canvas(viewer))
    for layer, visible in zip(viewer.layers, before, strict=True):
        layer.visible = visible
    return np.abs(pictures[0] - pictures[1]).max(axis=2) > 12


def the_packed_picture_lies_over_naparis_own(placed) -> None:
    viewer, controller, labels = placed
    session = controller.session
    voxels = np.array([session.boxes.center(i, np.ones(3)) for i in session.ids])
    for fov in (35.0, 0.0):
        viewer.scene.camera.perspective = fov
        assert controller.settle(60)
        frame = controller.frame
        pixels = frame.camera.project(voxels * session.spacing, frame.size)
        np.testing.assert_allclose(pixels, naparis_pixels(viewer, labels, voxels), atol=0.02)
        ours, theirs = seen(viewer, controller.layers), seen(viewer, [labels])
        assert theirs.sum() > 8000
        # napari's surface runs through the outermost voxels' middles or around them, ours between.
        assert (ours & theirs).sum() / (ours | theirs).sum() > 0.93
    # The mouse finds what napari finds, and a click to split lands under it.
    found = [(controller.interaction.packed_at(pixel) or [0])[0] for pixel in pixels]
    for pixel, object_id in zip(pixels, found, strict=True):
        voxel = surface_voxel(controller, pixel, object_id)
        assert session.labels[voxel] == object_id
        there = naparis_pixels(viewer, labels, np.array([voxel], dtype=float))[0]
        assert np.abs(there - pixel).max() < 6
    looking = viewer.scene.camera.view_direction
    labels.visible = True
    wanted = [
        labels.get_value(
            labels.data_to_world(voxel),
            view_direction=looking,
            dims_displayed=[0, 1, 2],
            world=True,
        )
        for voxel in voxels
    ]
    labels.visible = False
    assert len(set(found)) > 3
    assert found == wanted


def the_crosshair_of_slices_is_where_napari_has_its_voxel(placed, qtbot) -> None:
    viewer, controller, labels = placed
    session, linked = controller.session, LinkedSlices(controller)
    linked.open()
    viewer.scene.camera.perspective = 20.0
    assert controller.settle(60)
    widget = compat.native_canvas(viewer).native
    voxels = np.array([session.boxes.center(i, np.ones(3)) for i in session.ids])
    for row, col in naparis_pixels(viewer, labels, voxels).round().astype(int):
        for aside in (1, 0):
            move(widget, QPoint(int(col) + aside, int(row)))
            # napari hears of at most one movement in 5 ms.
            qtbot.wait(10)
        assert session.labels[linked.crosshair] == controller.interaction.pointed != 0
        there = naparis_pixels(viewer, labels, np.array([linked.crosshair], dtype=float))[0]
        assert np.abs(there - (row, col)).max() < 6
        linked.point_at(linked.crosshair)
        point, camera = linked.marker.point_in(controller.frame)
        marked = camera.pixels(point, controller.frame.size)
        np.testing.assert_allclose(marked, there, atol=0.02)
    linked.close()


def the_bags_up_is_up_in_the_picture_and_the_arrow_as_long_as_the_bag_is_wide(placed) -> None:
    _, controller, labels = placed
    session = controller.session
    at = np.array([labels.data_to_world(c / 1.5) for c in np.vstack([np.eye(3), np.zeros(3)])])
    linear = (at[:3] - at[3]).T
    # Lying flat or standing on edge, it never leaves downwards.
    assert (linear @ session.queries.bag_up())[1] < 1e-9
    level = linear.T @ [0.0, -1.0, 0.0]
    np.testing.assert_allclose(session.away_from_table, level / np.linalg.norm(level), atol=1e-9)
    session.direction = tuple(session.camera.in_world((0.0, 0.6, -0.8)))
    start, end = controller.overlays.arrow.ends(controller.frame)
    boxes = [session.boxes.corners(i, session.spacing) for i in session.ids]
    reach = np.linalg.norm((np.vstack(boxes) - session.bag.center) @ linear.T, axis=1).max()
    reach /= np.cbrt(abs(np.linalg.det(linear)))
    assert np.linalg.norm(end - start) == pytest.approx(1.05 * reach, rel=1e-6)
    np.testing.assert_allclose((end - start) / np.linalg.norm(end - start), [0, 0.6, -0.8])


def objects_leave_from_their_place_along_the_arrow_drawn_and_come_back(placed, qtbot) -> None:
    viewer, controller, labels = placed
    assert controller.settle(60)
    session, frame = controller.session, controller.frame
    packed = canvas(viewer)
    controller.interaction.pencil.take(np.array([300.0, 200.0]), np.array([240.0, 330.0]), False)
    ends = np.stack([session.bag.center, session.bag.center + 10 * session.unpack_direction])
    way = np.diff(naparis_pixels(viewer, labels, ends / session.spacing), axis=0)[0]
    np.testing.assert_allclose(way / np.linalg.norm(way), np.array([-60, 130]) / 143.18, atol=1e-3)
    (left,) = controller.unpack(1)[:1]
    start = session.flights[left].pose_at(0.0, frame.camera)
    home = naparis_pixels(viewer, labels, session.boxes.center(left, np.ones(3))[None])[0]
    np.testing.assert_allclose(frame.camera.pixels(start.center, frame.size), home, atol=0.02)
    controller.finish()
    assert controller.settle(60)
    # Drawn back to have room for it.
    pose, frame = session.poses[left], controller.frame
    assert controller.interaction.sprite_at(frame.camera.pixels(pose.center, frame.size)) == left
    # A sprite is turned, not bent or mirrored: its map is the bag's and a turn.
    of_bag, of_sprite = frame.camera.linear, pose.rotation @ pose.stretch
    np.testing.assert_allclose(of_sprite.T @ of_sprite, of_bag.T @ of_bag, atol=1e-9)
    assert np.linalg.det(of_sprite) * np.linalg.det(of_bag) > 0
    controller.restore(len(session.ids))
    controller.finish()
    session.direction = None
    assert set(session.states.values()) == {ObjectState.PACKED}
    assert controller.settle(60)
    qtbot.waitUntil(lambda: not controller.transition.images, timeout=60000)
    assert (np.abs(canvas(viewer) - packed).max(axis=2) > 3).mean() < 0.001


def test_everything_is_where_napari_has_it(placed, qtbot) -> None:
    # One start a placement, whatever is looked at: opening a viewer takes most of the time.
    viewer, controller, _ = placed
    the_bags_up_is_up_in_the_picture_and_the_arrow_as_long_as_the_bag_is_wide(placed)
    controller.session.direction = None
    the_packed_picture_lies_over_naparis_own(placed)
    the_crosshair_of_slices_is_where_napari_has_its_voxel(placed, qtbot)
    a_point_is_hidden_behind_an_object_and_seen_before_it(placed)
    viewer.scene.camera.perspective = 0.0
    objects_leave_from_their_place_along_the_arrow_drawn_and_come_back(placed, qtbot)


@pytest.mark.parametrize("placed", ["all of it"], indirect=True)
def test_both_backends_draw_the_same_at_rest_and_in_the_air(placed) -> None:
    viewer, controller, _ = placed
    viewer.scene.camera.perspective = 30
    session = controller.session
    session.clock = lambda: 100.0
    assert controller.settle(60)
    controller.unpack(2)
    session.clock = lambda: 100.1
    assert_alike(pictures_of_both(viewer, controller))
    controller.finish()
    controller.backend = "cpu"


def a_point_is_hidden_behind_an_object_and_seen_before_it(placed) -> None:
    viewer, controller, labels = placed
    viewer.scene.camera.perspective = 30
    assert controller.settle(60)
    session, camera = controller.session, controller.frame.camera
    center = session.boxes.center(6, session.spacing)
    ray = camera.direction
    for way, wanted in ((-45.0, True), (20.0, False)):
        without = canvas(viewer)
        world = labels.data_to_world((center + way * ray) / session.spacing)
        probe = viewer.add_points([world], size=9, face_color="white", border_width=0)
        viewer.layers.selection.active = controller.packed
        assert controller.settle(60)
        changed = np.abs(canvas(viewer) - without).max(axis=2) > 30
        row, col = camera.project(center + way * ray, controller.frame.size).round().astype(int)
        assert changed[row - 1 : row + 2, col - 1 : col + 2].all() == wanted
        assert changed.any() == wanted
        viewer.layers.remove(probe.name)


def test_an_object_inspected_turns_with_the_hand_on_a_mirrored_bag_too(
    make_napari_viewer_proxy, bag
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    image = viewer.add_image(bag[0], **PLACES["mirrored"])
    session = Session(*bag, spacing=(1.5, 1.5, 1.5))
    controller = SessionController(viewer, session, [image])
    controller.open()
    assert controller.settle(60)
    (left,) = controller.unpack(1)[:1]
    controller.finish()
    assert controller.settle(60)
    pose = session.poses[left]
    towards = np.linalg.inv(pose.rotation @ pose.stretch) @ [5.0, 0.0, 0.0]
    from napari_unpack.viewer.interaction import drag_rotation

    controller.renderer.held.turn(left, drag_rotation(np.array([0.0, 30.0])))
    controller.renderer.held.turned(left)
    pose = session.poses[left]
    # What faced the viewer has followed the mouse to the right.
    assert (pose.rotation @ pose.stretch @ towards)[2] > 0.5
    controller.close()


def test_axes_in_another_order_take_the_bag_and_what_has_left_it_along(
    make_napari_viewer_proxy, bag
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(620, 480)
    place = {"scale": (3.0, 1.0, -1.5), "rotate": (20.0, 0.0, 0.0), "translate": (4, 5, 6)}
    image = viewer.add_image(bag[0], **place)
    labels = viewer.add_labels(bag[1].astype(np.int32), visible=False, **place)
    session = Session(*bag, spacing=(3.0, 1.0, 1.5))
    controller = SessionController(viewer, session, [image, labels])
    controller.overlays.outlines_unpackable = controller.recolor_at_rest = False
    controller.open()
    assert controller.settle(60)
    (left,) = controller.unpack(1)[:1]
    controller.finish()
    assert controller.settle(60)
    voxels = np.array([session.boxes.center(i, np.ones(3)) for i in session.ids])

    def look(order) -> None:
        assert controller.settle(60)
        frame = controller.frame
        pixels = frame.camera.project(voxels * session.spacing, frame.size)
        # napari tells a hidden layer of no other order.
        labels.visible = True
        theirs = naparis_pixels(viewer, labels, voxels[:, order])
        labels.visible = False
        np.testing.assert_allclose(pixels, theirs, atol=0.02)
        # An odd order mirrors a bag that is mirrored by its layer already.
        odd = order in ([0, 2, 1], [1, 0, 2], [2, 1, 0])
        assert np.linalg.det(frame.camera.stretch) == pytest.approx(1.0 if odd else -1.0)
        assert controller.framing.is_fit
        assert (pixels > 0).all()
        assert (pixels < np.array(frame.size) - 1).all()
        at = frame.camera.pixels(session.poses[left].center, frame.size)
        assert controller.interaction.sprite_at(at) == left
        shape = session.poses[left].rotation @ session.poses[left].stretch
        assert np.linalg.det(shape) * np.linalg.det(frame.camera.linear) > 0

    angles = viewer.scene.camera.angles
    for order in ([1, 2, 0], [0, 2, 1]):
        viewer.dims.order = tuple(order)
        look(order)
        # As with napari's own layers, the bag is seen from another side by that.
        np.testing.assert_allclose(viewer.scene.camera.angles, angles, atol=1e-3)
    viewer.dims.ndisplay = 2
    viewer.dims.order = (2, 0, 1)
    viewer.dims.ndisplay = 3
    look([2, 0, 1])
    controller.close()
    # In slices again, by a person's own order: all is seen.
    middle = np.mean(viewer.layers.extent.world, axis=0)[[2, 0, 1]]
    np.testing.assert_allclose(viewer.scene.camera.center[1:], middle[1:], atol=3)
