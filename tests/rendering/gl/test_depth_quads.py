"""Quads among other visuals in a vispy scene."""

import numpy as np
import pytest

from napari_unpack.geometry.view import Camera

WIDTH, HEIGHT = 60, 40
RED, GREEN, BLUE = (1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1)


@pytest.fixture(params=[0.0, 35.0], ids=["orthographic", "perspective"])
def view(request, canvas):
    """A view box that fills a small canvas and looks at the origin."""
    from vispy import scene

    box = canvas.central_widget.add_view(border_width=0)
    box.camera = scene.cameras.ArcballCamera(fov=request.param, center=(3, 4, 5), scale_factor=60)
    # canvas.render() has 16 bits of depth: not enough for the default, 1e6 to both sides.
    box.camera.depth_value = 1e3
    canvas.render()
    return box


def add_cards(view, quads):
    """Add a quads node that follows the view's camera."""
    from vispy.scene.visuals import create_visual_node

    from napari_unpack.rendering.gl.depth_quads import QuadsVisual, clip_from_pivot
    from napari_unpack.rendering.gl.matrices import matrix_of

    node = create_visual_node(QuadsVisual)(parent=view.scene)

    def follow(visual):
        render = matrix_of(visual.get_transform("visual", "render"))
        visual.clip_from_pivot = clip_from_pivot(render, camera_of(render))

    node.before_draw = follow
    node.quads = quads
    return node


def camera_of(render):
    """Read the camera's axes off a clip matrix, x y z: what looks like z here is depth."""
    away = render[3, :3] if np.abs(render[3, :3]).max() > 1e-9 else render[2, :3]
    rows = [-away, -render[1, :3], render[0, :3]]
    rotation = np.stack([r[::-1] / np.linalg.norm(r) for r in rows])
    return Camera(rotation, np.array([5.0, 4.0, 3.0]), 60.0, 0.0)


def add_marker(view, towards, color, down=0.0, right=0.0):
    """Add a square marker at a point of pivot space."""
    from vispy.scene.visuals import Markers

    from napari_unpack.rendering.gl.matrices import matrix_of

    marker = Markers(parent=view.scene)
    camera = camera_of(matrix_of(marker.get_transform("visual", "render")))
    world = camera.center + camera.rotation.T @ [towards, down, right]
    look = {"size": 8, "face_color": color, "edge_width": 0, "symbol": "square"}
    marker.set_data(world[None, ::-1], **look)
    marker.antialias = 0
    marker.set_gl_state("translucent", depth_test=True, cull_face=False)
    return marker


def middle(view):
    return view.canvas.render()[HEIGHT // 2, WIDTH // 2]


def plain(color, alpha=1.0, size=(8, 8), depth=None):
    from napari_unpack.rendering.gl.depth_quads import ImageTexture

    pixels = np.empty((*size, 4), np.float32)
    pixels[:] = np.array([*color[:3], 1.0]) * alpha
    return ImageTexture(pixels, None if depth is None else np.full(size, depth, np.float32))


def quad(*arguments, **keywords):
    from napari_unpack.rendering.gl.depth_quads import Quad

    return Quad(*arguments, **keywords)


def sprite(towards, half=12.0):
    from napari_unpack.rendering.gl.depth_quads import PivotPlace

    return PivotPlace((towards, 0.0, 0.0), (half, half))


@pytest.mark.parametrize("marker_first", [True, False], ids=["marker first", "card first"])
@pytest.mark.parametrize("depth", [None, -2.0], ids=["flat", "with depths"])
def test_a_card_hides_what_is_behind_and_is_hidden_by_what_is_before(view, marker_first, depth):
    # The quad's surface is at t = -20 (towards 20): given flat, or as depth -2 of a place at 18.
    quads = [quad(plain(RED, depth=depth), sprite(20.0 if depth is None else 18.0))]
    for towards, wanted in ((15.0, RED), (25.0, GREEN)):
        nodes = []
        for adds_marker in (marker_first, not marker_first):
            nodes.append(
                add_marker(view, towards, GREEN) if adds_marker else add_cards(view, quads)
            )
        assert middle(view)[:3].tolist() == [255 * c for c in wanted[:3]]
        for node in nodes:
            node.parent = None


def test_a_marker_behind_shows_through_what_never_became_opaque(view):
    add_marker(view, -5.0, GREEN)
    # Alpha 0.4 and no depth anywhere: blended over the marker, premultiplied.
    add_cards(view, [quad(plain(RED, alpha=0.4, depth=np.inf), sprite(0.0))])
    np.testing.assert_allclose(middle(view)[:3], [102, 153, 0], atol=2)


def test_a_marker_drawn_later_behind_a_translucent_card_is_not_cut_out(view):
    add_cards(view, [quad(plain(RED, alpha=0.4, depth=np.inf), sprite(0.0))])
    add_marker(view, -5.0, GREEN)
    assert middle(view)[1] == 255


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_card_is_seen_whatever_the_order_of_the_list(view, order):
    quads = [quad(plain(RED), sprite(10.0)), quad(plain(BLUE), sprite(-10.0))]
    add_cards(view, [quads[i] for i in order])
    assert middle(view)[:3].tolist() == [255, 0, 0]


def test_a_soft_edge_blends_over_a_card_behind_it_whatever_the_order(view):
    near, far = quad(plain(RED, alpha=0.4), sprite(10.0)), quad(plain(BLUE), sprite(-10.0))
    add_cards(view, [near, far])
    np.testing.assert_allclose(middle(view)[:3], [102, 0, 153], atol=2)


def test_the_node_s_opacity_dims_colour_and_alpha_and_stops_hiding(view):
    add_cards(view, [quad(plain(RED), sprite(10.0))]).opacity = 0.4
    add_marker(view, -5.0, GREEN)
    assert middle(view)[1] == 255
    add_cards(view, [quad(plain(BLUE), sprite(20.0), opacity=0.5)])
    np.testing.assert_allclose(middle(view)[2], 128, atol=2)


def test_a_background_lies_behind_everything(view):
    from napari_unpack.rendering.gl.depth_quads import ScreenPlace

    add_marker(view, -25.0, GREEN)
    add_cards(view, [quad(plain(BLUE), ScreenPlace(ndc_depth=1.0))])
    picture = view.canvas.render()
    assert picture[HEIGHT // 2, WIDTH // 2, :3].tolist() == [0, 255, 0]
    assert picture[1, 1, :3].tolist() == [0, 0, 255]


def test_a_patch_lands_on_its_pixels_exactly(view):
    from napari_unpack.rendering.gl.depth_quads import ImageTexture, ScreenPlace

    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    place = ScreenPlace.of_pixels(12, 30, (5, 7), (HEIGHT, WIDTH))
    add_cards(view, [quad(ImageTexture(pixels), place)])
    np.testing.assert_array_equal(view.canvas.render()[12:17, 30:37, :3], pixels[..., :3])


def test_a_sprite_stands_where_its_pivot_point_is_projected(view):
    from napari_unpack.rendering.gl.depth_quads import PivotPlace

    add_cards(view, [quad(plain(RED), PivotPlace((8.0, -6.0, 9.0), (4.0, 3.0)))])
    lit = np.argwhere(view.canvas.render()[..., 0] > 128)
    marker = add_marker(view, 9.0, GREEN, down=-6.0, right=9.0)
    marker.set_gl_state("translucent", depth_test=False)
    found = np.argwhere(view.canvas.render()[..., 1] > 128)
    np.testing.assert_allclose(lit.mean(0), found.mean(0), atol=0.8)


def test_a_picture_is_uploaded_when_it_changes_and_not_when_its_card_moves(view):
    picture = plain(RED)
    node = add_cards(view, [quad(picture, sprite(0.0))])
    view.canvas.render()
    for towards in (1.0, 2.0, 3.0):
        node.quads = [quad(picture, sprite(towards))]
        view.canvas.render()
    assert picture.uploads == 1
    picture.update(np.full((8, 8, 4), 255, np.uint8))
    assert middle(view)[:3].tolist() == [255, 255, 255]
    assert picture.uploads == 2


def test_the_state_it_leaves_lets_the_next_frame_be_cleared(view):
    from OpenGL import GL

    add_cards(view, [quad(plain(RED), sprite(0.0))])
    view.canvas.render()
    view.canvas.context.flush_commands()
    assert GL.glGetBooleanv(GL.GL_DEPTH_WRITEMASK)


def test_it_frames_nothing_and_is_not_picked(view):
    node = add_cards(view, [quad(plain(RED), sprite(0.0))])
    assert node.bounds(0) is None
    node.interactive = True
    node.picking = True
    assert middle(view)[:3].tolist() == [0, 0, 0]


def test_wrong_pictures_are_refused_by_name():
    from napari_unpack.rendering.gl.depth_quads import ImageTexture

    with pytest.raises(ValueError, match="color must be"):
        ImageTexture(np.zeros((4, 4, 3), np.float32))
    with pytest.raises(TypeError, match="float64"):
        ImageTexture(np.zeros((4, 4, 4)))
    with pytest.raises(ValueError, match="depth must be"):
        ImageTexture(np.zeros((4, 4, 4), np.float32), np.zeros((3, 4), np.float32))
