"""Compute shaders beside gloo's programs: which pixels they write, and what they leave behind."""

import numpy as np
import pytest
from vispy import gloo

from napari_unpack.rendering.gl import compute_program, framebuffer
from napari_unpack.rendering.gl.compute_program import VERSION, ComputeProgram
from napari_unpack.rendering.gl.framebuffer import Target, Targets
from napari_unpack.rendering.gl.pixel_program import (
    ComputedPixels,
    FragmentProgram,
    pixel_program,
)
from napari_unpack.rendering.gl.programs import Programs, ShaderError, linked, load, read

PLACES = """#include "lib/pixel.glsl"
uniform float u_offset;
uniform sampler2D u_added;
void main() {
    if (OUTSIDE)
        return;
    WRITE_0(vec4(PIXEL, u_offset, texture2D(u_added, vec2(0.5)).r));
    WRITE_1(vec4(PIXEL.y - PIXEL.x));
}
"""


def source(code, **options):
    return load(
        "passes/probe", read=lambda path: code if "probe" in path else read(path), **options
    )


def drawn():
    program = linked(load("passes/fullscreen.vert"), source(PLACES))
    program["a_position"] = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]], np.float32)
    return FragmentProgram(program)


def computed():
    return ComputedPixels(ComputeProgram(source(PLACES, defines={"COMPUTE": 1}, version=VERSION)))


def uniforms(offset):
    added = np.full((1, 1, 1), 7, np.float32)
    texture = gloo.Texture2D(added, internalformat="r32f", interpolation="nearest")
    return {"u_offset": offset, "u_added": texture, "u_unknown": 1.0}


@pytest.mark.parametrize("make", [drawn, computed])
def test_every_pixel_of_any_size_knows_its_place(compute, make):
    target = Target((13, 21), (4, 1))
    make().run(target, uniforms(0.25))
    rows, columns = np.indices((13, 21))
    np.testing.assert_array_equal(
        target.read(0), np.stack([columns, rows, 0.25 + 0 * rows, 7 + 0 * rows], axis=-1)
    )
    np.testing.assert_array_equal(target.read(1)[..., 0], rows - columns)


@pytest.mark.parametrize("make", [drawn, computed])
def test_pixels_outside_the_window_stay_as_they_are(compute, make):
    target, program = Target((13, 21), (4, 1)), make()
    program.run(target, uniforms(1.0))
    program.run(target, uniforms(2.0), (3, 2, 10, 9))
    again = np.full((13, 21), 1.0)
    again[2:11, 3:13] = 2.0
    np.testing.assert_array_equal(target.read(0)[..., 2], again)
    rows, columns = np.indices((13, 21))
    np.testing.assert_array_equal(target.read(0)[..., 0], columns)
    np.testing.assert_array_equal(target.read(1)[..., 0], rows - columns)


def test_gloo_draws_with_its_own_program_again_after(compute):
    target, by_gloo, ours = Target((4, 5), (4, 1)), drawn(), computed()
    for offset in (1.0, 3.0):
        by_gloo.run(target, uniforms(offset))
        np.testing.assert_array_equal(target.read(0)[..., 2], offset)
        ours.run(target, uniforms(offset + 1))
        np.testing.assert_array_equal(target.read(0)[..., 2], offset + 1)


def test_a_wrong_compute_shader_is_reported_by_our_file_and_line(compute):
    code = PLACES.replace("PIXEL.y - PIXEL.x", "nothing")
    with pytest.raises(ShaderError, match=r"passes/probe:8\b"):
        ComputeProgram(source(code, defines={"COMPUTE": 1}, version=VERSION))


def test_a_pass_whose_compute_shader_is_refused_is_drawn(compute, monkeypatch):
    monkeypatch.setattr(compute_program, "preferred", lambda: True)
    programs, defines = Programs(), {"FOUND": 0}
    assert isinstance(pixel_program(programs, "object_id.glsl", defines), ComputedPixels)
    assert pixel_program(programs, "object_id.glsl", defines) is pixel_program(
        programs, "object_id.glsl", defines
    )
    monkeypatch.setattr(compute_program, "VERSION", "430 core")
    assert isinstance(pixel_program(Programs(), "object_id.glsl", defines), FragmentProgram)


def test_a_program_that_nobody_holds_is_deleted_in_its_context(compute, gl):
    from OpenGL import GL

    names = []
    for _ in range(3):
        program = ComputeProgram(source(PLACES, defines={"COMPUTE": 1}, version=VERSION))
        names.append(program.handle)
        assert GL.glIsProgram(program.handle)
        del program
    gl.flush_commands()
    assert not any(GL.glIsProgram(name) for name in names)


def test_a_pass_that_fails_leaves_no_scissors_behind(gl, monkeypatch):
    from OpenGL import GL

    program = linked(load("passes/fullscreen.vert"), source(PLACES))

    def fails(mode):
        gl.flush_commands()
        raise MemoryError("it is out of memory")

    monkeypatch.setattr(program, "draw", fails)
    with pytest.raises(MemoryError):
        FragmentProgram(program).run(Target((13, 21), (4, 1)), {}, (3, 2, 5, 4))
    gl.flush_commands()
    assert not GL.glIsEnabled(GL.GL_SCISSOR_TEST)


def test_a_target_longer_than_the_drivers_textures_is_refused_in_a_sentence(gl):
    from OpenGL import GL

    most = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
    Target((1, most)).delete()
    with pytest.raises(ValueError, match=f"at most {most} pixels"):
        Target((1, most + 1))


def test_large_targets_are_not_all_kept(gl, monkeypatch):
    monkeypatch.setattr(framebuffer, "MOST_KEPT", 100)
    targets = Targets((1,))
    for size in ((8, 10), (2, 3), (9, 10), (20, 20), (2, 2)):
        targets.get(size)
    assert targets.made == 5
    # Of those before the last only the last large one is gone; a small one beside it stays.
    for size, made in (((2, 2), 5), ((20, 20), 6)):
        targets.get(size)
        assert targets.made == made
