"""Surfaces enclose what the voxels do, lie where the objects were scanned, and are no mirror."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

import napari_unpack as nu
from napari_unpack.geometry.length_unit import MICRO, LengthUnit
from napari_unpack.io import surfaces
from napari_unpack.io.headless import packed_copy
from napari_unpack.io.surfaces import level_surface, object_surface, save_surfaces
from napari_unpack.session.containers import open_container
from napari_unpack.tasks import Cancelled, Share

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


@pytest.mark.parametrize("kind", ["one layer", "two layers", "three layers", "crumbs"])
def test_a_surface_of_a_large_thin_object_encloses_what_its_voxels_do(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mask = {
        "one layer": np.ones((1, 340, 340), bool),
        "two layers": np.ones((2, 260, 260), bool),
        "three layers": np.ones((3, 230, 230), bool),
        "crumbs": np.random.default_rng(0).random((65, 65, 65)) > 0.5,
    }[kind]
    # What takes time: on a large object each level takes seconds.
    levels: list[float] = []

    def counted(field: np.ndarray, level: float, share: Share) -> tuple[np.ndarray, np.ndarray]:
        levels.append(level)
        return level_surface(field, level, share)

    monkeypatch.setattr(surfaces, "level_surface", counted)
    mesh = trimesh.Trimesh(*object_surface(mask), process=False)
    assert mesh.is_watertight
    assert abs(mesh.volume) == pytest.approx(mask.sum(), rel=0.006)
    assert len(levels) <= 4


def blurred(kind: str) -> np.ndarray:
    z, y, x = np.indices((19, 22, 17))
    noise = np.random.default_rng(0).random(z.shape)
    mask = {
        "sphere": (z - 9) ** 2 + (y - 11) ** 2 + (x - 8) ** 2 < 60,
        "blobs": gaussian_filter(noise, 1.2) > 0.5,
        "grains": noise > 0.5,
        "at the level": noise > 0.5,
    }[kind]
    field = gaussian_filter(np.pad(mask.astype(np.float32), 4), 0.7)
    # Eighths: every twelfth voxel is at the level itself.
    return np.round(field * 8) / 8 if kind == "at the level" else field


def triangles_of(triangles: np.ndarray, names: np.ndarray) -> np.ndarray:
    """Return triangles by other names of their points, in an order of their own."""
    named = names[triangles]
    first = (named.argmin(axis=1)[:, None] + np.arange(3)) % 3
    return np.unique(np.take_along_axis(named, first, 1), axis=0)


@pytest.mark.parametrize("kind", ["sphere", "blobs", "grains", "at the level"])
def test_a_surface_found_in_slabs_is_that_of_the_whole(kind: str) -> None:
    field = blurred(kind)
    at_once = level_surface(field, 0.5, most=field.size)
    wholes = [at_once] if kind == "at the level" else [at_once, marching_cubes(field, 0.5)[:2]]
    for deep in (1, 2, 5, len(field) - 2, len(field) - 1):
        # A little less than one slice more: slabs are of whole slices.
        points, triangles = level_surface(field, 0.5, most=(deep + 1) * field[0].size - 1)
        assert trimesh.Trimesh(points, triangles, process=False).is_watertight
        for (wanted, faces), near in zip(wholes, (1e-5, 0.1), strict=False):
            away, which = cKDTree(wanted).query(points)
            assert away.max() < near
            assert np.quantile(away, 0.99) < 1e-3
            if kind == "at the level":
                # Several points of a voxel are all but one: which is which is not asked.
                assert (len(points), len(triangles)) == (len(wanted), len(faces))
                continue
            assert len(np.unique(which)) == len(points) == len(wanted)
            same = triangles_of(faces, np.arange(len(wanted)))
            np.testing.assert_array_equal(triangles_of(triangles, which), same)


def test_a_surface_is_cancelled_between_two_slabs(session: nu.Session, tmp_path: Path) -> None:
    told: list[float] = []

    def cancel(fraction: float, _text: str) -> None:
        told.append(fraction)
        if len(told) == 4:
            raise Cancelled

    field = blurred("sphere")
    with pytest.raises(Cancelled):
        level_surface(field, 0.5, Share(cancel), most=1)
    assert told == [k / (len(field) - 1) for k in range(4)]
    told.clear()
    with pytest.raises(Cancelled):
        save_surfaces(session, tmp_path / "bag.stl", progress=cancel)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb", ""])
def test_the_bar_never_goes_back(session: nu.Session, tmp_path: Path, suffix: str) -> None:
    told: list[float] = []
    save_surfaces(session, tmp_path / f"bag{suffix}", progress=lambda f, _: told.append(f))
    assert len(told) > 8
    assert told == sorted(told)
    assert told[-1] == 1


def test_an_obj_file_written_in_pieces_is_that_written_at_once(
    session: nu.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = save_surfaces(session, tmp_path / "whole.obj").read_bytes()
    monkeypatch.setattr(surfaces, "PIECE_ROWS", 7)
    checks: list[str] = []
    pieces = save_surfaces(
        session, tmp_path / "pieces.obj", progress=lambda _, text: checks.append(text)
    )
    assert pieces.read_bytes() == whole
    rows = sum(line[:1] in b"vf" for line in whole.splitlines())
    assert checks.count("Writing surfaces") >= rows / 7


def test_an_obj_file_of_nanometres_has_all_digits(tmp_path: Path) -> None:
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[2:6, 2:6, 2:6] = 1
    session = nu.Session(labels * np.uint16(1500), labels, (1e-6, 1e-6, 1e-6))
    mesh = trimesh.load_mesh(save_surfaces(session, tmp_path / "grain.obj"))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(64e-18, rel=0.1, abs=0)


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
    if suffix in (".ply", ".obj"):
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


def test_files_in_a_folder_have_the_ids_of_the_labels_given(tmp_path: Path) -> None:
    labels = np.zeros((8, 6, 10), np.int64)
    labels[2:6, 1:5, 1:4], labels[2:6, 1:5, 6:9] = 10, 700_000
    session = nu.Session(np.where(labels, 1000, 0).astype(np.uint16), labels)
    folder = save_surfaces(session, tmp_path / "parts")
    names = sorted(file.name for file in folder.iterdir())
    assert names == ["010 Object 10.stl", "700000 Object 700000.stl"]


def test_an_object_named_twice_is_written_once(session: nu.Session, tmp_path: Path) -> None:
    once = trimesh.load_mesh(save_surfaces(session, tmp_path / "once.stl", [BALL]))
    twice = trimesh.load_mesh(save_surfaces(session, tmp_path / "twice.stl", [BALL, BALL]))
    assert twice.is_watertight
    assert twice.volume == pytest.approx(once.volume)


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
    with pytest.raises(ValueError, match=r"ids must be objects of this session, got \[9\]"):
        save_surfaces(session, tmp_path / "bag.stl", [9])


@pytest.mark.parametrize("ids", [[1.9], "12", [True]])
def test_what_is_no_id_chooses_no_object(session: nu.Session, tmp_path: Path, ids: object) -> None:
    with pytest.raises(TypeError, match="ids must be object IDs"):
        save_surfaces(session, tmp_path / "bag.stl", ids)
    assert not list(tmp_path.iterdir())


def test_without_trimesh_one_sentence_says_what_to_install(
    session: nu.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ImportError, match=r"writing surfaces needs trimesh.*pip install trimesh"):
        save_surfaces(session, tmp_path / "bag.stl")
    assert list(tmp_path.iterdir()) == []


def test_objects_of_one_name_are_all_in_the_scene_and_long_names_are_cut(tmp_path: Path) -> None:
    labels = np.zeros((8, 6, 14), np.uint8)
    for i in range(3):
        labels[2:6, 1:5, 1 + 4 * i : 4 + 4 * i] = i + 1
    session = nu.Session(np.where(labels, 1000, 0).astype(np.uint16), labels)
    for i in session.ids:
        session.rename(i, "shoe, part")
    scene = trimesh.load(save_surfaces(session, tmp_path / "a.glb"))
    assert len(scene.graph.nodes_geometry) == len(scene.geometry) == 3
    session.rename(1, "箱" * 100)
    files = sorted(save_surfaces(session, tmp_path / "prints").iterdir())
    assert [file.name[:4] for file in files] == ["001 ", "002 ", "003 "]
    assert max(len(file.name.encode()) for file in files) <= 255


def test_surfaces_of_what_is_in_an_opened_container_lie_beside_those_of_the_bag(
    tmp_path: Path,
) -> None:
    labels = np.zeros((50, 50, 50), np.uint16)
    labels[10:40, 12:42, 15:45] = 1
    labels[13:37, 15:39, 18:42] = 0
    labels[20:30, 20:30, 20:30], labels[20:30, 20:30, 32:38] = 2, 3
    outer = nu.Session(np.where(labels > 0, 1000 + labels * 300, 0), labels, (1, 2, 0.5))
    outer.backend = "cpu"
    inner = outer.opened_bags.open(outer, 1)
    inner.rename(3, "lamp")
    nu.save_session(outer, tmp_path / "bag.unpack")
    saved = nu.open_session(tmp_path / "bag.unpack")
    again = saved.opened_bags.open(saved, 1)
    assert again.objects["name"][3] == "lamp"
    bounds = []
    for session in (outer, inner, again, packed_copy(inner)):
        save_surfaces(session, tmp_path / "3.stl", [3])
        bounds.append(trimesh.load(tmp_path / "3.stl").bounds)
    # The middle of the object, x to the left and y to the back as in the scan, z upside down.
    np.testing.assert_allclose(bounds[0].mean(axis=0), (34.5 * 0.5, 24.5 * 2, -24.5), atol=1e-4)
    np.testing.assert_allclose(bounds[1:], [bounds[0]] * 3, atol=1e-4)
    # A scan that lies askew in the scanner, whose layer is turned as well.
    askew = np.array([[0, 0, 1.0, 7], [0, -1, 0, 8], [1, 0, 0, 9], [0, 0, 0, 1]])
    turned = np.array([[0, 1.0, 0, 1], [-1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    outer.scanner_from_scan = askew
    bounds = []
    for session in (outer, open_container(outer, 1)):
        save_surfaces(session, tmp_path / "3.stl", [3], turned)
        bounds.append(trimesh.load(tmp_path / "3.stl").bounds)
    np.testing.assert_allclose(bounds[1], bounds[0], atol=1e-4)


def test_an_opened_container_saved_by_itself_still_tells_where_it_lay(tmp_path: Path) -> None:
    labels = np.zeros((30, 30, 30), np.uint16)
    labels[8:24, 8:24, 8:24] = 1
    labels[9:23, 9:23, 9:23] = 0
    labels[10:20, 10:20, 10:14], labels[10:20, 10:20, 16:22] = 2, 3
    outer = nu.Session(np.where(labels > 0, 1000 + labels * 300, 0), labels, (1, 2, 0.5))
    outer.backend = "cpu"
    askew = np.array([[0, 0, 1.0, 7], [0, -1, 0, 8], [1, 0, 0, 9], [0, 0, 0, 1]])
    turned = np.array([[0, 1.0, 0, 1], [-1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    for place in (None, askew):
        outer.scanner_from_scan = place
        inner = open_container(outer, 1)
        # One in another: what is unpacked in it is saved along with it.
        inner.opened_bags.restore(inner, 1, open_container(inner, 1))
        path = nu.save_session(inner, tmp_path / "inner.unpack")
        again = nu.open_session(path)
        within = again.opened_bags.worked_in(again)[1]
        bounds = []
        for session in (outer, inner, again, within):
            save_surfaces(session, tmp_path / "3.stl", [3], turned)
            bounds.append(trimesh.load(tmp_path / "3.stl").bounds)
        np.testing.assert_allclose(bounds[1:], [bounds[0]] * 3, atol=1e-4)


def test_a_surface_of_an_oblique_sheet_encloses_what_its_voxels_do() -> None:
    z, y, x = np.indices((90, 90, 90))
    mask = z + y - x == 40
    points, triangles = object_surface(mask)
    mesh = trimesh.Trimesh(points, triangles, process=False)
    assert abs(mesh.volume) == pytest.approx(mask.sum(), rel=0.01)
