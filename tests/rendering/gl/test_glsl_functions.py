"""Single GLSL functions over many inputs, against numpy."""

from contextlib import nullcontext

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import Shading
from napari_unpack.rendering.gl import offscreen
from napari_unpack.rendering.gl.framebuffer import Target
from napari_unpack.rendering.gl.programs import linked, load, read
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import assign, plane_uniforms, ray_uniforms
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer

FULL_SCREEN = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]], dtype=np.float32)


def probe(include, expression, inputs, uniforms, declarations="", head="", held=None):
    """Evaluate a GLSL expression of vec4 a, b for every row of `inputs` (N, 1 or 2, 4)."""
    from vispy import gloo

    body = f"""
{head}
#include "lib/{include}"
uniform sampler2D u_inputs;
uniform float u_count;
{declarations}
void main() {{
    vec4 a = texture2D(u_inputs, vec2(0.25, gl_FragCoord.y / u_count));
    vec4 b = texture2D(u_inputs, vec2(0.75, gl_FragCoord.y / u_count));
    gl_FragColor = {expression};
}}
"""
    source = load("probe", read=lambda path: body if path == "probe" else read(path))
    program = linked(load("passes/fullscreen.vert"), source)
    table = np.zeros((len(inputs), 2, 4), np.float32)
    table[:, : inputs.shape[1]] = inputs
    program["a_position"] = gloo.VertexBuffer(FULL_SCREEN)
    texture = gloo.Texture2D(table, internalformat="rgba32f", interpolation="nearest")
    assign(program, {"u_inputs": texture, "u_count": float(len(inputs)), **uniforms})
    target = Target((len(inputs), 1))
    with nullcontext() if held is None else held.bound(program), target.drawing():
        program.draw("triangle_strip")
    return target.read()[:, 0]


def rows(points):
    """Pack (N, up to 4) values into the probe's (N, 1, 4)."""
    out = np.zeros((len(points), 1, 4), np.float32)
    out[:, 0, : points.shape[1]] = points
    return out


def test_every_label_up_to_65535_is_read_exactly(gl):
    labels = np.arange(65536, dtype=np.uint16).reshape(4, 128, 128)
    textures = VolumeTextures(labels)
    textures.send()
    voxels = np.argwhere(labels >= 0)[::7]
    uniforms = ray_uniforms(Rays(np.zeros((6, 3)), (1, 1), 1.0), textures)
    found = probe("label_lookup.glsl", "vec4(label_at(a.xyz))", rows(voxels[:, ::-1]), uniforms)
    np.testing.assert_array_equal(found[:, 0], labels[tuple(voxels.T)])


def test_an_id_table_gives_every_object_its_own_row(gl):
    from napari_unpack.rendering.gl.lookup_tables import IdTable

    values = np.zeros((65536, 4), np.float32)
    values[:, 0] = np.arange(65536)
    table = IdTable()
    uniforms = {"u_values": table.update(values), "u_rows": float(table.rows)}
    ids = np.array([0, 1, 255, 256, 257, 40000, 65535], dtype=np.float32)[:, None]
    found = probe(
        "label_lookup.glsl",
        "table_row(u_values, u_rows, a.x)",
        rows(ids),
        uniforms,
        declarations="uniform sampler2D u_values; uniform float u_rows;",
    )
    np.testing.assert_array_equal(found[:, 0], ids[:, 0])


@pytest.fixture
def ramp(gl):
    """A 4 x 5 x 6 volume with density 1000 z + 100 y + 10 x, and its uniforms."""
    z, y, x = np.mgrid[:4, :5, :6]
    volume = (1000 * z + 100 * y + 10 * x).astype(np.uint16)
    textures = VolumeTextures(np.ones((4, 5, 6), np.uint16), volume, as_buffer=False)
    textures.send()
    uniforms = ray_uniforms(Rays(np.zeros((6, 3)), (1, 1), 1.0), textures)
    return uniforms | {"u_density": textures.density}


def test_density_is_trilinear_with_centres_at_integers_and_clamped(ramp):
    z, y, x = np.random.default_rng(0).uniform(-1.5, 7.0, (3, 200))
    found = probe("density.glsl", "vec4(density_at(a.xyz))", rows(np.stack([x, y, z], 1)), ramp)
    places = [np.clip(z, 0, 3), np.clip(y, 0, 4), np.clip(x, 0, 5)]
    if not offscreen.is_software():
        # A card blends with weights of 8 bits, and rounds what comes to the texture's own 16.
        places = [np.rint(256 * place) / 256 for place in places]
    wanted = np.dot([1000, 100, 10], places)
    atol = 0.6 if offscreen.is_software() else 1.0
    np.testing.assert_allclose(found[:, 0] * 65535, wanted, atol=atol)


def test_the_gradient_of_a_ramp_is_its_slope(ramp):
    inside = np.random.default_rng(1).uniform(1.0, 2.0, (50, 3))
    found = probe("gradient.glsl", "vec4(gradient_at(a.xyz), 0.0)", rows(inside), ramp)
    np.testing.assert_allclose(found[:, :3] * 65535, [[10, 100, 1000]] * 50, atol=0.6)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_voxels_of_a_buffer_give_density_and_gradient_also_at_the_edges(gl, kind):
    rng = np.random.default_rng(5)
    shape = (4, 5, 6)
    volume = rng.integers(0, 250, shape).astype(kind)
    held = VoxelBuffer(shape, kind)
    held.set_data(volume[:1], (0, 0, 0))
    held.set_data(volume[1:], (1, 0, 0))
    # Edge voxels, half a voxel beyond them, and anywhere between.
    points = rng.uniform(-0.5, np.array(shape) - 0.51, (400, 3))
    points[:100] = np.rint(points[:100])
    points[100:110] = -0.5
    expression = "gradient_and_density_at(a.xyz, ivec3(5, 4, 3), ivec3(1, 6, 30))"
    textures = VolumeTextures(np.ones(shape, np.uint16))
    textures.send()
    uniforms = ray_uniforms(Rays(np.zeros((6, 3)), (1, 1), 1.0), textures)
    head = "#extension GL_EXT_gpu_shader4 : require"
    found = probe(
        "voxel_buffer.glsl", expression, rows(points[:, ::-1]), uniforms, head=head, held=held
    )
    scale = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}[kind]
    ends = np.eye(3)
    at = lambda p: map_coordinates(volume.astype(float), p.T, order=1, mode="nearest")  # noqa: E731
    np.testing.assert_allclose(found[:, 3] * scale, at(points), atol=2e-2)
    for axis in range(3):
        wanted = (at(points + ends[2 - axis]) - at(points - ends[2 - axis])) / 2
        np.testing.assert_allclose(found[:, axis] * scale, wanted, atol=2e-2)


def test_the_transfer_function_is_linear_between_entries_and_clamped(gl):
    from vispy import gloo

    table = np.array([[[0, 0, 0, 0], [0, 1, 0, 0.5], [1, 1, 1, 0.1]]], dtype=np.float32)
    uniforms = {
        "u_table": gloo.Texture2D(table, internalformat="rgba32f", interpolation="nearest"),
        "u_table_size": 3.0,
        # Entries 0, 1, 2 stand for densities 100, 200, 300.
        "u_entry": (0.01, -1.0),
    }
    densities = np.array([-5, 100, 150, 200, 275, 300, 9000], dtype=np.float32)[:, None]
    found = probe("transfer_function.glsl", "transfer(a.x)", rows(densities), uniforms)
    wanted = [
        [0, 0, 0, 0],
        [0, 0, 0, 0],
        [0, 0.5, 0, 0.25],
        [0, 1, 0, 0.5],
        [0.75, 1, 0.75, 0.2],
        [1, 1, 1, 0.1],
        [1, 1, 1, 0.1],
    ]
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_light_follows_the_formula_of_shading(gl):
    rng = np.random.default_rng(2)
    gradient = rng.normal(size=(100, 3)).astype(np.float32)
    gradient[:3] = 0
    along = rng.normal(size=(100, 3))
    along = (along / np.linalg.norm(along, axis=1, keepdims=True)).astype(np.float32)
    light = Shading(ambient=0.3, diffuse=0.7, specular=0.25, shininess=24.0)
    uniforms = {
        "u_light": (light.ambient, light.diffuse, light.specular, light.shininess),
        "u_steepness": 0.8,
    }
    inputs = np.zeros((100, 2, 4), np.float32)
    inputs[:, 0, :3], inputs[:, 1, :3] = gradient, along
    found = probe("light.glsl", "vec4(light_of(a.xyz, b.xyz), 0.0, 0.0)", inputs, uniforms)
    steep = np.linalg.norm(gradient, axis=1)
    c = np.abs((gradient * along).sum(1)) / np.maximum(steep, 1e-9)
    s = np.minimum(steep * 0.8, 1.0)
    np.testing.assert_allclose(found[:, 0], 0.3 + 0.7 * (1 - s + s * c), atol=1e-5)
    np.testing.assert_allclose(found[:, 1], 0.25 * s * c**24.0, atol=1e-5)


def test_a_ray_visits_exactly_the_samples_inside_the_volume(gl):
    textures = VolumeTextures(np.ones((5, 6, 7), np.uint16))
    textures.send()
    rng = np.random.default_rng(3)
    origins, directions = rng.uniform(-6, 12, (2, 300, 3))
    directions[:20, 0] = 0.0
    rays = Rays(np.zeros((6, 3)), (1, 1), step=0.13, near=-2.0)
    inputs = np.zeros((300, 2, 4), np.float32)
    inputs[:, 0, :3], inputs[:, 1, :3] = origins, directions
    uniforms = ray_uniforms(rays, textures) | plane_uniforms(None)
    expression = "vec4(sample_range(a.xyz, b.xyz, 0.5), 0.0, 0.0)"
    found = probe("ray_box.glsl", expression, inputs, uniforms)
    k = np.arange(-2000, 2000)
    t = (k + 0.5) * 0.13
    for origin, direction, (first, end) in zip(
        *inputs[:, :, :3].swapaxes(0, 1), found[:, :2], strict=True
    ):
        p = origin.astype(float) + t[:, None] * direction.astype(float)
        inside = ((np.floor(p + 0.5) >= 0) & (np.floor(p + 0.5) < (7, 6, 5))).all(1) & (t > -2.0)
        edge = np.abs(p + 0.5 - np.rint(p + 0.5)).min(1)
        wanted = k[inside]
        if wanted.size and edge[[wanted[0] + 1999, wanted[-1] + 2001]].min() < 1e-4:
            continue
        assert (first, end) == ((wanted[0], wanted[-1] + 1) if wanted.size else (first, first))


def test_jitter_is_the_hash_of_the_cpu_twin(gl):
    pixels = np.random.default_rng(4).integers(0, 2000, (100, 2))
    found = probe("ray.glsl", "vec4(jittered_phase(a.xy))", rows(pixels), {})
    inner = (0.06711056 * pixels[:, 0] + 0.00583715 * pixels[:, 1]) % 1.0
    wanted = (52.9829189 * inner) % 1.0
    # Far from its wrap-around, where float32 and float64 may fall on different sides.
    calm = (np.abs(wanted - 0.5) < 0.45) & (np.abs(inner - 0.5) < 0.49)
    np.testing.assert_allclose(found[calm, 0], wanted[calm], atol=2e-2)
