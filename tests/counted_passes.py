"""How often the packed bag is cast."""

from __future__ import annotations

from typing import Any


def settled_passes(controller: Any) -> int:
    """Wait for all pictures; return how many of the bag have been cast so far."""
    assert controller.settle(30)
    return int(controller.renderer.packed_renderer.passes)


def assert_camera_hue_and_transfer_function_each_cast_anew(viewer: Any, controller: Any) -> None:
    session, passes = controller.session, settled_passes(controller)
    viewer.scene.camera.zoom *= 1.1
    after_zoom = settled_passes(controller)
    assert passes < after_zoom <= passes + 3
    session.apply_hues({7: 0.123}, undoable=False)
    after_hue = settled_passes(controller)
    assert after_hue == after_zoom + 1
    function = session.transfer_function
    session.transfer_function = type(function)([(d, a / 2) for d, a in function.points])
    assert after_hue < settled_passes(controller) <= after_hue + 2
