"""The shaders against the CPU ray caster, on random small volumes.

IDs are exact on every ray that is clear of voxel faces: whose samples all lie at least CLEAR
voxels from one, a float32 position in a volume of this size being good to about 1e-5. Colours
agree within 2/255 on the same rays, depths to one step's rounding.
"""

import numpy as np
import pytest
from vispy import gloo

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.gl import backend as gl_backend
from napari_unpack.rendering.gl import compute_program, textures
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer

CLEAR = 2e-4
SIZE = (30, 36)


class Case:
    """A random bag of boxes, a random view of it, a random look."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.shape = tuple(int(n) for n in rng.integers(7, 23, 3))
        self.spacing = (1.0, 1.0, 1.0) if seed % 3 == 0 else tuple(rng.uniform(0.5, 2.0, 3))
        self.labels = np.zeros(self.shape, np.uint16)
        names = rng.choice(60_000 if seed % 4 == 0 else 200, 9, replace=False) + 1
        for name in names:
            low = rng.integers(0, np.array(self.shape) - 2)
            box = tuple(slice(a, a + n) for a, n in zip(low, rng.integers(2, 9, 3), strict=True))
            self.labels[box] = name
        grain = rng.integers(0, 1500, self.shape)
        self.volume = (grain + (self.labels > 0) * 600).astype(
            np.float32 if seed % 5 == 0 else np.uint16
        )
        self.visible = np.zeros(int(names.max()) + 1, bool)
        self.visible[names[:6]] = True
        self.tints = np.zeros((len(self.visible), 4), np.float32)
        self.tints[names, :3] = rng.uniform(0.2, 1.0, (9, 3))
        self.tints[names[:6], 3] = rng.choice([1.0, 0.5], 6)
        self.tints[0] = (1, 1, 1, seed % 2)
        self.table = np.ones((33, 4), np.float32)
        self.table[:, :3] = rng.uniform(0.3, 1.0, (33, 3))
        opacity = (0.03, 0.2, 0.9)[seed % 3]
        self.table[:, 3] = np.clip(np.linspace(-0.5, 1.0, 33), 0, 1) * opacity
        self.domain = (200.0, 2000.0)
        direction = tuple(rng.normal(size=3))
        view = View(direction=direction, fov=0.0 if seed % 2 else float(rng.uniform(20, 60)))
        camera = view.camera(self.shape, self.spacing, stretch_of(seed))
        step = float(rng.uniform(0.4, 1.2) * min(self.spacing))
        self.rays = cast_rays(camera, SIZE, voxel_from_world(self.spacing), step)
        self.shading = Shading() if seed % 4 else None
        self.bricks = cpu.Bricks.of(self.labels, self.volume)

    def clear(self):
        """(H, W) of bool: rays all of whose samples lie clear of voxel faces."""
        pixels = np.stack([np.ones(SIZE), *np.indices(SIZE)], axis=-1)
        start, slope = pixels @ self.rays.table[:3], pixels @ self.rays.table[3:]
        reach = float(np.linalg.norm(np.array(self.shape) * self.spacing)) / self.rays.step
        k = np.arange(-int(reach) - 2, int(reach) + 2)
        t = (k + 0.5) * self.rays.step
        p = start[..., None, :] + t[:, None] * slope[..., None, :] + 0.5
        inside = ((p > -CLEAR) & (p < np.array(self.shape) + CLEAR)).all(-1) & (t > self.rays.near)
        return ~(inside & (np.abs(p - np.rint(p)) < CLEAR).any(-1)).any(-1)


def stretch_of(seed):
    """How napari's affine bends the bag: not at all, mirrored, stretched, or sheared and both."""
    rng = np.random.default_rng(1000 + seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    lengths = np.exp(rng.normal(0.0, 0.4, 3))
    sheared = turn * (lengths / lengths.prod() ** (1 / 3)) @ turn.T
    return (None, -np.eye(3), np.diag([2.0, 1.0, 0.5]), sheared, -sheared)[seed % 5]


@pytest.fixture(params=[False, True], ids=["drawn", "computed"])
def computed(request, gl, monkeypatch):
    """Whether pixels are computed by compute shaders, as on a card, or drawn."""
    monkeypatch.setattr(compute_program, "preferred", lambda: request.param)
    return request.param


@pytest.mark.parametrize("seed", range(50))
def test_object_id_shaders_match_the_cpu_ray_caster(computed, seed):
    case = Case(seed)
    clear = case.clear()
    assert clear.mean() > 0.5
    arguments = (case.labels, case.rays, case.visible, 1 + seed % 9)
    wanted = cpu.id_layers(*arguments)
    found = gl_backend.id_layers(*arguments)
    skipped = gl_backend.id_layers(*arguments, bricks=case.bricks)
    assert wanted[0].any()
    np.testing.assert_array_equal(found[:, clear], wanted[:, clear])
    np.testing.assert_array_equal(skipped[:, clear], wanted[:, clear])


@pytest.fixture(params=["voxels", "filtered", "computed"])
def density_held(request, gl, monkeypatch):
    """Density as a buffer of voxels, as for software rasterisers, or as a 3D texture."""
    buffered = request.param == "voxels"
    monkeypatch.setattr(textures, "serves_best", lambda _: buffered)
    monkeypatch.setattr(compute_program, "preferred", lambda: request.param == "computed")
    yield VoxelBuffer if buffered else gloo.Texture3D
    gl_backend.forget()


@pytest.mark.parametrize("seed", range(50))
def test_tinted_shaders_match_the_cpu_ray_caster(density_held, filter_tolerance, seed):
    case = Case(seed)
    clear = case.clear()
    look = (case.table, case.domain, case.tints, case.shading)
    arguments = (case.volume, case.labels, case.rays, case.spacing, *look)
    image, depth = cpu.tinted(*arguments)
    found, found_depth = gl_backend.tinted(*arguments, bricks=case.bricks)
    held = gl_backend.workspace_here().textures(case.labels, case.volume).density
    assert isinstance(held, density_held)
    assert image[..., 3].max() > 0.02
    most = 2 / 255 if density_held is VoxelBuffer else filter_tolerance
    difference = np.abs(found - image)[clear]
    assert difference.max() <= most
    assert difference.mean() <= 0.25 / 255
    reached = np.isfinite(depth) & np.isfinite(found_depth)
    # Where alpha grazes 1/2 a rounding decides which sample reaches it.
    grazing = np.abs(image[..., 3] - 0.5) < most
    same = np.isfinite(depth) == np.isfinite(found_depth)
    assert same[clear & ~grazing].all()
    late = np.abs(np.subtract(found_depth, depth, where=reached, out=np.zeros(SIZE))) > 1e-3
    assert (late & clear).mean() < 0.005


def test_jittered_pictures_match_too(gl):
    case = Case(7)
    look = (case.table, case.domain, case.tints, None)
    arguments = (case.volume, case.labels, case.rays, case.spacing, *look)
    image, _ = cpu.tinted(*arguments, jitter=True)
    found, _ = gl_backend.tinted(*arguments, jitter=True)
    # The hash wraps around in float32 and float64 at different pixels, and a jittered sample
    # may cross a face: all but a few pixels agree.
    assert (np.abs(found - image).max(-1) > 2 / 255).mean() < 0.03


def test_clipping_planes_cut_both_backends_alike(gl):
    case = Case(3)
    middle = np.array(case.shape) / 2
    planes = np.array([[middle, [1.0, 0.3, -0.2]], [middle + 0.3, [-0.1, 0.0, 1.0]]])
    arguments = (case.labels, case.rays, case.visible, 3)
    whole = cpu.id_layers(*arguments)
    wanted = cpu.id_layers(*arguments, clipping=planes)
    found = gl_backend.id_layers(*arguments, clipping=planes)
    assert (wanted != whole).any()
    clear = case.clear()
    assert (found != wanted)[:, clear].mean() < 0.002


def test_a_corner_on_view_shows_its_nearest_object_in_the_middle_pixel(gl):
    # Two slabs one behind the other along z, seen along +z: the first is object 3.
    labels = np.zeros((4, 3, 3), np.uint16)
    labels[1], labels[3] = 3, 8
    camera = View(direction=(1, 0, 0), height=3.0).camera((4, 3, 3), (1, 1, 1))
    rays = cast_rays(camera, (3, 3), voxel_from_world((1, 1, 1)), 0.5)
    visible = np.zeros(9, bool)
    visible[[3, 8]] = True
    found = gl_backend.id_layers(labels, rays, visible, 3)
    assert found[:, 1, 1].tolist() == [3, 8, 0]
    visible[3] = False
    assert gl_backend.id_layers(labels, rays, visible, 1)[0, 1, 1] == 8


def test_more_layers_than_the_shader_holds_are_refused(gl):
    case = Case(1)
    with pytest.raises(ValueError, match="layers must be 1 to 32"):
        gl_backend.id_layers(case.labels, case.rays, case.visible, 33)


def test_a_volume_is_uploaded_once_for_many_pictures(gl):
    case = Case(11)
    workspace = gl_backend.Workspace()
    first = workspace.textures(case.labels, case.volume)
    assert workspace.textures(case.labels, case.volume) is first
    assert workspace.textures(case.labels, None) is first
    assert first.uploads == 2
    assert workspace.textures(case.labels.copy(), None) is not first
