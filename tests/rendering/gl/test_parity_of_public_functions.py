"""The public functions on both backends: what a person calls gives one image, whoever draws.

`test_parity.py` holds the shaders against the kernels; here everything in between counts too:
views, steps, hidden objects, tints, transfer functions, odd dtypes and compacted IDs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.transforms import Pose, rotation_about
from napari_unpack.rendering.compose import sprite_image

CLEAR = 3e-4
"""Voxels from a face within which a float32 position may fall on either side."""

SIZE = (27, 33)
TYPES = (np.uint8, np.uint16, np.int32, np.int64)


@dataclass
class Scene:
    """A random small bag of ellipsoids and a random look at it."""

    volume: np.ndarray
    labels: np.ndarray
    names: np.ndarray
    place: dict
    look: dict

    @classmethod
    def of(cls, seed: int) -> Scene:
        rng = np.random.default_rng(9000 + seed)
        shape = tuple(int(n) for n in rng.integers(9, 22, 3))
        spacing = tuple(float(s) for s in rng.uniform(0.4, 2.5, 3))
        dtype = TYPES[seed % 4]
        # Every eighth bag has IDs that have to be compacted.
        top = 3_000_000 if seed % 8 == 3 else min(int(np.iinfo(dtype).max), 60_000)
        names = np.sort(rng.choice(np.arange(1, top), 7, replace=False))
        labels = np.zeros(shape, dtype)
        grid = np.indices(shape).reshape(3, -1).T
        for name in names:
            middle, radius = rng.uniform(0, shape), rng.uniform(2, 6, 3)
            inside = (((grid - middle) / radius) ** 2).sum(1) < 1
            labels[inside.reshape(shape)] = name
        volume = 100 + 700.0 * (labels > 0) + rng.integers(0, 500, shape)
        if seed % 5 == 0:
            volume[tuple(rng.integers(0, shape))] = np.nan
        else:
            volume = volume.astype(np.uint16 if seed % 5 < 3 else np.int16)
        view = nu.View(
            direction=tuple(rng.normal(size=3)),
            up=tuple(rng.normal(size=3)) if seed % 3 == 0 else None,
            height=float(rng.uniform(8, 30)) if seed % 4 == 1 else None,
            fov=float(rng.uniform(15, 70)) if seed % 2 else 0.0,
        )
        step = float(rng.uniform(0.3, 1.1)) * min(spacing) if seed % 3 else None
        place = {"spacing": spacing, "view": view, "size": SIZE, "step": step}
        colors = [(100.0, rng.uniform(0.2, 1, 3)), (1200.0, rng.uniform(0.2, 1, 3))]
        steep = (0.05, 0.3, 0.95)[seed % 3]
        look = {
            "transfer_function": nu.TransferFunction([(300, 0), (700, 0.3 * steep), (1300, steep)],
                                                     colors),
            "tints": {int(n): (*rng.uniform(0, 1, 3), rng.choice([0.4, 1.0])) for n in names[:5]},
            "shading": (Shading(), None, Shading(0.1, 0.6, 0.6, 40.0))[seed % 3],
        }  # fmt: skip
        return cls(volume, labels, names, place, look)

    def clear(self, shift: float) -> np.ndarray:
        """(H, W) of bool: rays none of whose samples lies at a voxel's face.

        Written from CONVENTIONS.md alone: pixels, pivot plane, lattice of t, the last moved on
        by `shift` steps where rays are parallel.
        """
        spacing = np.array(self.place["spacing"])
        camera = self.place["view"].camera(self.labels.shape, spacing)
        step = self.place["step"] or spacing.min()
        rows, cols = np.indices(SIZE)
        pixel = camera.height / SIZE[0]
        point = (
            camera.center
            + ((rows - (SIZE[0] - 1) / 2) * pixel)[..., None] * -camera.up
            + ((cols - (SIZE[1] - 1) / 2) * pixel)[..., None] * camera.right
        )
        slope = np.broadcast_to(camera.direction, point.shape)
        if camera.fov:
            shift = 0.0
            slope = (point - camera.center) / camera.distance + camera.direction
        reach = int(np.linalg.norm(np.array(self.labels.shape) * spacing) / step) + 2
        t = (np.arange(-reach, reach) + 0.5 + shift) * step
        at = (point[..., None, :] + t[:, None] * slope[..., None, :]) / spacing + 0.5
        near = ((at > -CLEAR) & (at < np.array(self.labels.shape) + CLEAR)).all(-1)
        near &= t > -camera.distance
        return ~(near & (np.abs(at - np.rint(at)) < CLEAR).any(-1)).any(-1)


@pytest.mark.parametrize("seed", range(50))
def test_object_id_layers_and_render_agree_on_both_backends(
    gl, filter_tolerance: float, seed: int
) -> None:
    scene = Scene.of(seed)
    hidden = [int(i) for i in scene.names[5:6]]

    # The ID passes stand a quarter of a step off the lattice (rendering.casting.off_faces).
    clear = scene.clear(0.25)
    assert clear.mean() > 0.5
    layers = {"layers": 1 + seed % 4, "hidden": hidden}
    ids = nu.object_id_layers(scene.labels, backend="cpu", **scene.place, **layers)
    drawn = nu.object_id_layers(scene.labels, backend="gl", **scene.place, **layers)
    assert drawn.dtype == ids.dtype
    assert len(np.unique(ids)) >= 2
    np.testing.assert_array_equal(drawn[:, clear], ids[:, clear])

    clear = scene.clear(0.0)
    assert clear.mean() > 0.5
    hidden = [0, *hidden] if seed % 2 else hidden
    bag = scene.volume, scene.labels
    image = nu.render(*bag, backend="cpu", hidden=hidden, **scene.place, **scene.look)
    drawn = nu.render(*bag, backend="gl", hidden=hidden, **scene.place, **scene.look)
    assert image[..., 3].max() > 0.02
    difference = np.abs(drawn - image)[clear]
    assert difference.max() <= filter_tolerance
    assert difference.mean() <= 0.25 / 255


def test_both_backends_draw_the_same_smooth_sprite(gl) -> None:
    away = np.linalg.norm(np.moveaxis(np.indices((40, 40, 40)), 0, -1) - 20.0, axis=-1)
    labels = np.where(away < 12, 2, 0).astype(np.uint16)
    labels[away < 5.2] = 1
    session = nu.Session(np.where(labels > 0, 1000, 0).astype(np.uint16), labels, (1.0, 1.0, 1.0))
    turn = rotation_about((0.0, 1.0, 0.0), 0.5) @ rotation_about((0.0, 0.0, 1.0), 0.4)
    pose = Pose(np.zeros(3), turn, 1.0)
    ours, theirs = (
        sprite_image(session.scene(), 1, pose, 8.0, backend=b).rgba for b in ("cpu", "gl")
    )
    assert ours[..., 3].max() > 0.5
    assert ours.shape == theirs.shape
    assert np.abs(ours - theirs).mean() < 2 / 255
