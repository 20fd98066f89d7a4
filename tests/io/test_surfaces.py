"""Surfaces enclose what the voxels do, lie where the objects were scanned, and are no mirror."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.geometry.length_unit import MICRO, LengthUnit
from napari_unpack.io.surfaces import object_surface, save_surfaces

trimesh = pytest.importorskip("trimesh")

SPACING = (2.0, 0.5, 1.0)
SHELL, BALL, DOT = 1, 2, 3


@pytest.fixture(scope="module")
def session() -> nu.Session:
    """Return a tray, a ball beside its middle and one voxel in a corner."""
    z, y, x = np.indices((20, 48, 30))
    labels = np.zeros(z.shape, np.uint8)
    labels[2:4, 4:44, 2:28] = SHELL
    labels[((z - 11) * 2.0) ** 2 + ((y - 14) * 0.5) ** 2 + (x - 20) ** 2 < 36] = BALL
    labels[18, 45, 1] = DOT
    return nu.Session(np.where(labels, 1000, 0).astype(np.uint16), labels, SPACING)


@pytest.mark.parametrize("kind", ["ball", "sheet", "rod", "voxel", "hollow"])
def test_a_surface_encloses_what_the_voxels_do(kind: str) -> None:
    z, y, x = np.indices((26, 26, 26)) - 13
    r2 = z**2 + y**2 + x**2
    mask = {
        "ball": r2 < 100,
        "sheet": (z == 0) & (abs(y) < 10) & (abs(x) < 9),
        "rod": (z == 0) & (y == 0) & (abs(x) < 11),
        "voxel": r2 == 0,
        "hollow": (r2 < 144) & (r2 > 81),
    }[kind]
    points, triangles = object_surface(mask)
    mesh = trimesh.Trimesh(points, triangles, process=False)
    assert mesh.is_watertight
    assert abs(mesh.volume) == pytest.approx(mask.sum(), rel=0.006)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_every_format_has_the_objects_in_mm_in_scanner_axes(
    session: nu.Session, tmp_path: Path, suffix: str
) -> None:
    path = save_surfaces(session, tmp_path / f"bag{suffix}", [SHELL, BALL])
    scene = trimesh.load_scene(path, **({"split_objects": True} if suffix == ".obj" else {}))
    unit = 1000 if suffix == ".glb" else 1
    voxels = session.objects["volume_mm3"]
    assert scene.volume * unit**3 == pytest.approx(voxels[SHELL] + voxels[BALL], rel=0.01)
    # x to the left, y to the back, and z to the head, where voxels count to the feet.
    low, high = scene.bounds * unit
    np.testing.assert_allclose(low, (1.5, 1.2, -27.5), atol=0.6)
    np.testing.assert_allclose(high, (27.5, 21.75, -3.0), atol=0.6)
    if suffix in (".obj", ".glb"):
        assert sorted(scene.geometry) == ["Object 1", "Object 2"]
        ball = scene.geometry["Object 2"]
        assert ball.volume * unit**3 == pytest.approx(voxels[BALL], rel=0.01)
        np.testing.assert_allclose(ball.center_mass * unit, (20, 7, -22), atol=0.1)
    if suffix == ".ply":
        wanted = np.rint(255 * np.clip(session.solo_tints(BALL)[BALL, :3], 0, 1))
        body = next(b for b in scene.to_mesh().split() if abs(b.center_mass[1] - 7) < 0.5)
        np.testing.assert_allclose(body.visual.vertex_colors[0, :3], wanted, atol=1)


def test_a_folder_has_a_file_for_each_object(session: nu.Session, tmp_path: Path) -> None:
    folder = save_surfaces(session, tmp_path / "parts", standing=np.diag([1, 1, -1.0, 1]))
    names = ["001 Object 1.stl", "002 Object 2.stl", "003 Object 3.stl"]
    assert sorted(file.name for file in folder.iterdir()) == names
    for i, name in zip(session.ids, names, strict=True):
        mesh = trimesh.load_mesh(folder / name)
        # Also of a bag that its layer mirrors, whose surfaces would be inside out.
        assert mesh.volume == pytest.approx(session.objects["volume_mm3"][i], rel=0.01)
    assert mesh.center_mass[0] == pytest.approx(-1, abs=0.1)


def test_micrometres_are_told_in_millimetres(session: nu.Session, tmp_path: Path) -> None:
    try:
        session.length_unit = LengthUnit(MICRO)
        path = save_surfaces(session, tmp_path / "ball.stl", [BALL])
    finally:
        session.length_unit = "mm"
    assert trimesh.load_mesh(path).extents.max() == pytest.approx(0.012, rel=0.05)


def test_other_formats_and_objects_are_refused(session: nu.Session, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"surfaces must end in .stl, .obj, .ply or .glb"):
        save_surfaces(session, tmp_path / "bag.step")
    with pytest.raises(ValueError, match=r"ids must be objects of the session, got \[9\]"):
        save_surfaces(session, tmp_path / "bag.stl", [9])


def test_without_trimesh_one_sentence_says_what_to_install(
    session: nu.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ImportError, match=r"writing surfaces needs trimesh.*pip install trimesh"):
        save_surfaces(session, tmp_path / "bag.stl")
    assert list(tmp_path.iterdir()) == []
