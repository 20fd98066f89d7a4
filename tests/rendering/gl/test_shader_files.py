"""What every GLSL file owes its reader, and that every pass compiles here."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FILES = sorted(
    p for p in (ROOT / "shaders").rglob("*") if p.suffix in {".glsl", ".frag", ".vert", ".comp"}
)


def head_of(path):
    return path.read_text().split("\n\n", 1)[0]


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_a_shader_opens_with_its_purpose_twin_and_test(path):
    head = head_of(path)
    assert head.startswith("// ")
    assert all(line.startswith("//") for line in head.splitlines())
    assert "// cpu twin:" in head
    assert "// test:" in head


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_a_shader_names_a_twin_and_a_test_that_exist(path):
    named = re.findall(r"[\w/]+\.py", head_of(path))
    for name in named:
        inside = ROOT / name if name.startswith("tests/") else ROOT / "src/napari_unpack" / name
        assert inside.exists(), name
    assert any(name.startswith("tests/") for name in named)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_the_functions_a_shader_names_are_in_its_twin(path):
    for file, names in re.findall(r"([\w/]+\.py) \(([\w., ]+)\)", head_of(path)):
        text = (ROOT / "src/napari_unpack" / file).read_text()
        for name in re.findall(r"\w+", names):
            assert re.search(rf"^\s*(def |class )?{name}\b", text, re.MULTILINE), (file, name)


NEWER = {"voxel_buffer.glsl", "invocation.glsl", "interfering.comp", "count_occluded.comp"}
"""Passes for drivers that have more, each with another way for those that have not."""


@pytest.mark.parametrize("path", [f for f in FILES if f.name not in NEWER], ids=lambda p: p.name)
def test_a_shader_stays_within_glsl_120(path):
    code = re.sub(r"//.*", "", path.read_text())
    assert not re.search(
        r"\b(usampler\w+|isampler\w+|uint|texelFetch|texture\(|layout|in vec)", code
    )


@pytest.mark.parametrize(
    ("fragment", "vertex", "defines"),
    [
        ("tinted_volume.glsl", "fullscreen.vert", {}),
        ("tinted_volume.glsl", "fullscreen.vert", {"SHADED": 1}),
        ("object_id.glsl", "fullscreen.vert", {"FOUND": 0}),
        ("object_id.glsl", "fullscreen.vert", {"FOUND": 7}),
        ("occluded_first_hit.frag", "fullscreen.vert", {}),
        ("quad.frag", "quad.vert", {}),
    ],
)
def test_every_pass_compiles_and_links(gl, fragment, vertex, defines):
    from napari_unpack.rendering.gl.programs import compiled

    assert compiled(fragment, defines, vertex).variables


def test_a_wrong_shader_is_reported_by_our_file_and_line(gl):
    from napari_unpack.rendering.gl.programs import ShaderError, linked, load, read

    files = {
        "passes/broken.frag": '#include "lib/broken.glsl"\nvoid main() { gl_FragColor = f(); }\n',
        "lib/broken.glsl": "// a comment\nvec4 f() {\n    return nothing;\n}\n",
    }
    fragment = load("passes/broken.frag", read=lambda path: files.get(path) or read(path))
    with pytest.raises(ShaderError, match=r"lib/broken\.glsl:3\b"):
        linked(load("passes/fullscreen.vert"), fragment)
