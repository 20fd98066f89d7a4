"""Who casts, and that what it casts passes through the doors as it is."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from napari_unpack import rendering
from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import View
from napari_unpack.rendering.backends import chosen
from napari_unpack.rendering.cpu import Bricks, tinted

CPU = {"backend": "cpu"}


class Fog:
    """A transfer function: opacity 1/4 a voxel everywhere, white."""

    domain = (0.0, 1.0)

    def table(self, n: int = 2) -> np.ndarray:
        return np.tile(np.array([1, 1, 1, 0.25], np.float32), (n, 1))


def test_auto_takes_the_cpu_where_gl_is_missing_or_software(monkeypatch) -> None:
    from napari_unpack.rendering import backends

    class Driver:
        def __init__(self, available: bool, software: bool) -> None:
            self.available, self.hardware = lambda: available, lambda: available and not software
            self.unavailable_because = lambda: "it belongs to another thread"

    for available, software, name in [
        (False, False, "napari_unpack.rendering.cpu"),
        (True, True, "napari_unpack.rendering.cpu"),
        (True, False, "napari_unpack.rendering.gl.backend"),
    ]:
        monkeypatch.setattr(backends, "gl_driver", lambda a=available, s=software: Driver(a, s))
        assert chosen("auto").__name__ == name
    monkeypatch.setattr(backends, "gl_driver", lambda: Driver(False, False))
    assert chosen("cpu").__name__ == "napari_unpack.rendering.cpu"
    with pytest.raises(ValueError, match="GL context: it belongs to another thread; use"):
        chosen("gl")


@pytest.mark.parametrize("problem", ["passes/tinted_volume.glsl:41: no", "it is out of memory"])
def test_where_a_driver_refuses_auto_takes_the_cpu_and_says_why_once(monkeypatch, problem) -> None:
    from napari_unpack.rendering import backends

    asked = []

    class Driver:
        hardware = staticmethod(lambda: not asked)
        give_up = staticmethod(lambda: asked.append("given up"))
        available = staticmethod(lambda: True)

    class Shaders:
        @staticmethod
        def tinted(*_: object, **__: object) -> None:
            raise RuntimeError(problem)

    monkeypatch.setattr(backends, "gl_driver", lambda: Driver)
    monkeypatch.setattr(backends, "gl_backend", lambda: Shaders)
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[2:6, 2:6, 2:6] = 1
    camera = View().camera(labels.shape, (1, 1, 1))
    tints = np.array([[0, 0, 0, 0], [1, 1, 1, 1]], np.float32)
    arguments = (labels, labels, (1, 1, 1), camera, Fog(), tints, (20, 20))
    wanted, _ = rendering.cast_tinted(*arguments, backend="cpu")
    with pytest.warns(RuntimeWarning, match=re.escape(problem)):
        found, _ = rendering.cast_tinted(*arguments)
    np.testing.assert_array_equal(found, wanted)
    assert wanted.max() > 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rendering.cast_tinted(*arguments)
    assert asked == ["given up"]
    with pytest.raises(RuntimeError, match=re.escape(problem)):
        rendering.cast_tinted(*arguments, backend="gl")


def test_cast_tinted_puts_an_object_at_a_pose() -> None:
    # A 2 mm cube around world (3, 3, 3), sent to 3 mm right of the middle, twice as large.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[2:4, 2:4, 2:4] = 1
    camera = View(direction=(0, 0, 1), height=20.0).camera(labels.shape, (1, 1, 1))
    pose = Pose(np.array([0.0, 0.0, 3.0]), camera.rotation, 2.0)
    affine = voxel_from_world((1, 1, 1)) @ np.linalg.inv(
        pose.world_from_world((2.5, 2.5, 2.5), camera)
    )
    tints = np.array([[0, 0, 0, 0], [1, 1, 1, 1]], np.float32)
    # 40 pixels over 20 mm: 4 mm are 8 pixels, about column 19.5 + 6 and row 19.5.
    image, depth = rendering.cast_tinted(
        labels, labels, (1, 1, 1), camera, Fog(), tints, (40, 40), voxel_from_world=affine, **CPU
    )
    rows, cols = np.nonzero(image[..., 3])
    assert (rows.min(), rows.max()) == (16, 23)
    assert (cols.min(), cols.max()) == (22, 29)
    # Enlarged, it still is two voxels thick: 1 - 0.75^2.
    assert image[20, 25, 3] == pytest.approx(0.4375, abs=1e-3)
    part, _ = rendering.cast_tinted(
        labels, labels, (1, 1, 1), camera, Fog(), tints, (40, 40), voxel_from_world=affine,
        window=(14, 20, 12, 11), bricks=Bricks.of(labels, labels), **CPU,
    )  # fmt: skip
    np.testing.assert_allclose(part, image[14:26, 20:31], atol=1e-6)
    assert np.isinf(depth).all()


def test_cast_doors_are_the_kernels_on_the_usual_rays() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 4, (9, 8, 7)).astype(np.uint16)
    camera = View(direction=(0.3, 0.4, 0.6), fov=30.0).camera(labels.shape, (1, 2, 1))
    tints = np.ones((4, 4), np.float32)
    rays = cast_rays(camera, (11, 12), voxel_from_world((1, 2, 1)), 0.5)
    expected = tinted(labels, labels, rays, (1, 2, 1), Fog().table(), (0, 1), tints, Shading())
    found = rendering.cast_tinted(
        labels, labels, (1, 2, 1), camera, Fog(), tints, (11, 12),
        step_scale=0.5, shading=Shading(), **CPU,
    )  # fmt: skip
    np.testing.assert_allclose(found[0], expected[0], atol=1e-5)
    visible = np.array([False, True, True, True])
    ids = rendering.cast_ids(labels, (1, 2, 1), camera, visible, (11, 12), 2, **CPU)
    assert ids.shape == (2, 11, 12)
    counts = rendering.cast_occlusion(labels, (1, 2, 1), camera, visible, (11, 12), **CPU)
    flat = rendering.occlusion(labels, (1, 2, 1), View(
        direction=(0.3, 0.4, 0.6), height=camera.height), size=(11, 12), **CPU)  # fmt: skip
    assert counts.samples.tolist() == flat.samples.tolist()
