"""The interactive page: one safe file, and the session's shapes, hues, order and paths in it."""

from __future__ import annotations

import base64
import colorsys
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from test_simplified_surfaces import spread

import napari_unpack as nu
from napari_unpack.geometry.view import View
from napari_unpack.io import interactive_page, save_interactive_page
from napari_unpack.io.headless import packed_copy
from napari_unpack.io.surfaces import object_surface
from napari_unpack.tasks import Cancelled

SPACING = (2.0, 1.0, 1.5)
NASTY = '</script><script>alert(1)</script><img src=x onerror="alert(2)">'
HUES = {1: 0.02, 2: 0.33, 3: 0.66, 4: 0.5}


def bag(scale: float = 1.0) -> nu.Session:
    """Return a row of four: a wedge, a ball, a rod and a box, which leave to the left in turn."""
    z, y, x = np.indices((24, 40, 90))
    labels = np.zeros(z.shape, np.uint16)
    labels[(x > 3) & (x < 20) & (y > 4) & (y < x + 6) & (z > 3) & (z < 18)] = 1
    labels[((z - 11) * 2.0) ** 2 + (y - 20) ** 2 + ((x - 33) * 1.5) ** 2 < 196] = 2
    labels[10:13, 4:36, 50:53] = 3
    labels[4:20, 6:30, 62:84] = 4
    spacing = scale * np.array(SPACING)
    session = nu.Session(np.where(labels, 1500, 0).astype(np.uint16), labels, spacing)
    session.view = View((0.5, 0.75, 0.3), fov=20.0)
    session.direction = "-x"
    session.apply_hues(HUES)
    session.tint_mode = "hsv"
    return session


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, nu.Session]:
    session = bag()
    session.unpack(2)
    session.rename(3, NASTY)
    session.annotations.set_note(2, "<!-- ]]> " + NASTY)
    before = dict(session.states)
    path = save_interactive_page(
        session, tmp_path_factory.mktemp("page") / "bag.html", "A <bag>", backend="cpu"
    )
    assert session.states == before
    return path.read_text("utf-8"), session


def told(text: str) -> dict:
    (data,) = re.findall(r'<script type="application/json" id="bag">(.*?)</script>', text, re.S)
    bag = json.loads(data)
    for one in bag["objects"]:
        one["id"] = int(one["id"])
    return bag


def shape(one: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of an object about the middle of its box, as the page reads."""
    grid = np.frombuffer(base64.b64decode(one["points"]), "<u2").reshape(-1, 3)
    triangles = np.frombuffer(base64.b64decode(one["triangles"]), "<u2").reshape(-1, 3)
    return np.array(one["low"]) + np.array(one["grid"]) * grid, triangles


def placed(one: dict, row: int) -> np.ndarray:
    """Return the points where the path has them: right, up, towards the viewer."""
    pose = np.reshape(one["path"], (-1, 9))[row]
    return Rotation.from_quat(pose[4:8]).apply(shape(one)[0]) * pose[3] + pose[:3]


def stated(text: str) -> float:
    (mm,) = re.findall(r"simplified by at most ([\d.]+) mm", text)
    return float(mm)


def faces(session: nu.Session, object_id: int) -> np.ndarray:
    """Return the middles of all voxel faces on an object's surface, mm, by brute force."""
    mask = np.pad(session.labels == object_id, 1)
    found = []
    for axis in range(3):
        for way in (1, -1):
            at = np.argwhere(mask & ~np.roll(mask, -way, axis)).astype(float) - 1
            at[:, axis] += way / 2
            found.append(at)
    return np.concatenate(found) * session.spacing


def seen(session: nu.Session, world: np.ndarray) -> np.ndarray:
    """Return where world points stand: right, up, towards the viewer, from the bag's middle."""
    where = np.argwhere(session.labels > 0)
    middle = (where.min(axis=0) + where.max(axis=0)) / 2 * session.spacing
    axes = [session.camera.right, session.camera.up, -session.camera.direction]
    return (world - middle) @ np.transpose(axes)


def test_it_is_one_file_that_asks_the_network_for_nothing(page: tuple[str, nu.Session]) -> None:
    text, _ = page
    code = re.sub(
        r'"[A-Za-z0-9+/=]{200,}"', '""', re.sub(r"data:image/webp;base64,[\w+/=]+", "data:", text)
    )
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(|<link|<iframe|fetch\(|XMLHttp", code)
    assert set(re.findall(r'\ssrc="?([^"\s>]*)', code.replace(NASTY, ""))) <= {"data:", "x"}
    (policy,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]+)">', text)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules.keys() == {"default-src", "img-src", "style-src", "script-src"}
    assert (rules["default-src"], rules["img-src"]) == ("'none'", "data:")
    # Nothing runs but our two scripts, and these do.
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    assert sorted(rules["script-src"].split()) == sorted(f"'sha256-{d}'" for d in digests)
    assert text.index("Content-Security-Policy") < text.index("<style")


def test_names_and_notes_are_text_wherever_they_stand(page: tuple[str, nu.Session]) -> None:
    text, _ = page
    assert NASTY not in text
    assert "<!--" not in text
    assert "<img src=x" not in text
    assert len(re.findall("<script", text)) == len(re.findall("</script>", text)) == 3
    assert {one["id"]: one["name"] for one in told(text)["objects"]}[3] == NASTY
    assert "<h1>A &lt;bag&gt;</h1>" in text
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in text


def test_order_and_hues_are_the_sessions(page: tuple[str, nu.Session]) -> None:
    data = told(page[0])
    assert (data["step"], data["steps"]) == (2, 4)
    # The left one first, as they stand in a row and leave to the left.
    assert {one["id"]: one["step"] for one in data["objects"]} == {1: 1, 2: 2, 3: 3, 4: 4}
    for one in data["objects"]:
        hue, saturation, _ = colorsys.rgb_to_hsv(*one["color"])
        assert hue == pytest.approx(HUES[one["id"]], abs=0.002)
        assert saturation > 0.5
    rows = re.findall(
        r'<tr data-id="(\d+)">.*?</td><td[^>]*>(\d+)</td><td[^>]*>(\d+)</td>', page[0]
    )
    assert rows == [("1", "1", "1"), ("2", "2", "2"), ("3", "3", "3"), ("4", "4", "4")]
    # Nobody has flagged anything, so there is no such column.
    heads = re.findall(r'<th scope="col"[^>]*><button>([^<]+)', page[0])
    assert heads == ["Name", "ID", "Order out", "Volume cm³", "Note"]


def test_ids_are_told_apart_that_no_number_of_a_browser_does(tmp_path: Path) -> None:
    first = bag()
    huge = 720575940612453042
    labels = np.array([0, huge, huge + 1, huge + 2, huge + 3])[first.labels]
    session = nu.Session(first.volume, labels, first.spacing)
    path = save_interactive_page(session, tmp_path / "bag.html", backend="cpu")
    text = path.read_text("utf-8")
    (data,) = re.findall(r'<script type="application/json" id="bag">(.*?)</script>', text, re.S)
    # As a browser reads it: all its numbers are floats.
    ids = [one["id"] for one in json.loads(data, parse_int=float)["objects"]]
    assert sorted(ids) == [str(huge + k) for k in range(4)]
    assert ids == re.findall(r'<tr data-id="(\d+)">', text)


def test_surfaces_are_where_the_labels_are_and_as_near_as_the_page_says(
    page: tuple[str, nu.Session],
) -> None:
    text, session = page
    # Half a voxel's diagonal: between points of voxel faces, and what a smooth surface cuts off.
    voxel = float(np.linalg.norm(SPACING)) / 2
    for one in told(text)["objects"]:
        points = placed(one, 0)
        _, triangles = shape(one)
        wanted = seen(session, faces(session, one["id"]))
        found = spread(points, triangles)
        assert cKDTree(wanted).query(found)[0].max() <= stated(text) + voxel
        assert cKDTree(found).query(wanted)[0].max() <= stated(text) + voxel
        a, b, c = (points[triangles[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        # Positive: the outside is outside.
        assert volume == pytest.approx((session.labels == one["id"]).sum() * 3.0, rel=0.1)


def test_a_page_of_a_tiny_bag_says_as_exactly_how_near_its_surfaces_are(
    page: tuple[str, nu.Session], tmp_path: Path
) -> None:
    # The same shapes: what is near in a bag of one 4096th is so by as much less.
    tiny = save_interactive_page(bag(2.0**-12), tmp_path / "a.html", backend="cpu")
    near = stated(tiny.read_text("utf-8"))
    # Both are rounded up to two digits, by up to a tenth.
    assert near == pytest.approx(stated(page[0]) / 4096, rel=0.1)


def test_a_path_leads_from_the_bag_along_the_direction_and_round_the_bag_to_the_slot(
    page: tuple[str, nu.Session],
) -> None:
    text, session = page
    shown = packed_copy(session)
    shown.canvas_size = interactive_page.WINDOW
    shown.go_to(4)
    data = told(text)
    out = seen(session, np.array([[0.0, 0.0, -1.0]])) - seen(session, np.zeros((1, 3)))
    for one in data["objects"]:
        path = np.reshape(one["path"], (-1, 9))
        assert (path[0, 3], path[0, 8], path[-1, 8]) == (1.0, 0.0, 1.0)
        assert (np.diff(path[:, 8]) >= 0).all()
        straight = path[path[:, 8] == 0, :3] - path[0, :3]
        along = straight @ out[0]
        np.testing.assert_allclose(straight, along[:, None] * out, atol=1e-3)
        # Until its box is out of the bag's, of which the last sample before has four fifths.
        columns = np.flatnonzero((session.labels == one["id"]).any(axis=(0, 1)))
        assert 0.78 * (columns.max() - 3) * 1.5 < along.max() <= (columns.max() - 3) * 1.5
        pose = shown.poses[one["id"]]
        down, right = pose.center[1:]
        np.testing.assert_allclose(path[-1, :3], [right, -down, pose.center[0]], atol=1e-2)
        assert path[-1, 3] == pytest.approx(pose.scale, rel=1e-4)
    # All that is out is in view, and the bag alone is larger.
    heights = data["heights"]
    assert len(heights) == 5
    assert heights == sorted(heights)
    assert heights[0] < heights[-1]
    rows, cols = interactive_page.WINDOW
    for one in data["objects"]:
        reach = np.abs(placed(one, -1)).max(axis=0)
        assert (reach[:2] <= [heights[-1] / 2 * cols / rows, heights[-1] / 2]).all()


def test_a_mirrored_bag_is_shown_mirrored_with_its_outside_outside(tmp_path: Path) -> None:
    session = bag()
    session.look(type(session.camera).looking((0, 0, 1), None, (0, 0, 0), 100, 0.0, -np.eye(3)))
    text = save_interactive_page(session, tmp_path / "a.html", backend="cpu").read_text("utf-8")
    wedge = next(one for one in told(text)["objects"] if one["id"] == 1)
    points, triangles = shape(wedge)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    wanted = seen(session, faces(session, 1))
    # `right` of a mirrored camera is where napari draws it; the wedge itself is mirrored.
    box = np.array([wanted.min(axis=0), wanted.max(axis=0)])
    found = placed(wedge, 0)
    np.testing.assert_allclose(np.array([found.min(axis=0), found.max(axis=0)]), box, atol=2.0)


def test_hidden_objects_are_left_out_and_the_page_says_so(tmp_path: Path) -> None:
    session = bag()
    session.hide([2])
    session.annotations.set_note(2, "hidden")
    text = save_interactive_page(session, tmp_path / "a.html", backend="cpu").read_text("utf-8")
    assert [one["id"] for one in told(text)["objects"]] == [1, 3, 4]
    assert "Hidden objects are left out: 1." in text
    # Nor is there a column of their notes.
    assert "<button>Note</button>" not in text
    session.hide([1, 3, 4])
    with pytest.raises(ValueError, match="all objects are hidden"):
        save_interactive_page(session, tmp_path / "b.html")


def test_a_page_has_pictures_for_browsers_without_webgl(page: tuple[str, nu.Session]) -> None:
    import imageio.v3 as iio

    pictures = re.findall(r'<img src="data:image/webp;base64,([\w+/=]+)" alt="([^"]+)"', page[0])
    assert [words for _, words in pictures] == [
        "Everything is packed.",
        "Step 2 of 4.",
        "Step 4 of 4.",
    ]
    for data, _ in pictures:
        image = iio.imread(base64.b64decode(data), extension=".webp")
        assert image.shape[:2] == interactive_page.WINDOW
        assert image[..., :3].max() > 100
    # Shown until a script finds WebGL.
    assert '<div id="live" hidden>' in page[0]
    assert '<div id="stills">' in page[0]


def test_forty_large_objects_take_at_most_15_mb_and_the_page_says_what_that_costs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Cells that fill a volume have as much surface as 40 objects can. Of a small one it is as far
    # above a small limit.
    most, room = interactive_page.GEOMETRY_BYTES, interactive_page.GEOMETRY_BYTES / 12
    monkeypatch.setattr(interactive_page, "GEOMETRY_BYTES", room)
    seeds = np.random.default_rng(0).uniform(0, 1, (40, 3)) * (32, 48, 68)
    z, y, x = np.indices((32, 48, 68))
    apart, nearest = cKDTree(seeds).query(np.stack([z, y, x], -1).reshape(-1, 3), k=2)
    inside = (apart[:, 1] - apart[:, 0] > 1.5) & (np.sin(x.ravel() * 1.8) < 0.5)
    labels = np.where(inside, nearest[:, 0] + 1, 0).astype(np.uint16).reshape(z.shape)
    session = nu.Session(np.where(labels, 1500, 0).astype(np.uint16), labels)
    path = save_interactive_page(session, tmp_path / "forty.html", backend="cpu")
    text = path.read_text("utf-8")
    objects = told(text)["objects"]
    assert len(objects) == 40
    surfaces = sum(len(one["points"]) + len(one["triangles"]) for one in objects)
    assert room / 2 < surfaces <= room
    # Pictures, paths and the table take what they take beside surfaces of any size.
    assert path.stat().st_size - surfaces + most <= 15e6
    for one in objects[::13]:
        found = spread(placed(one, 0), shape(one)[1])
        voxels, _ = object_surface(labels == one["id"])
        # Crumbs of a voxel are on no exported surface, and so on none of the page.
        wanted = seen(session, voxels)
        assert cKDTree(wanted).query(found)[0].max() <= stated(text) + 3**0.5 / 2
        assert cKDTree(found).query(wanted)[0].max() <= stated(text) + 3**0.5 / 2
        faced = seen(session, faces(session, one["id"]))
        assert cKDTree(faced).query(found)[0].max() <= stated(text) + 3**0.5 / 2
    # Coarser than one step alone would be: it was over the size at first.
    assert stated(text) > 1


def test_it_is_html_and_cancelling_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="html"):
        save_interactive_page(bag(), tmp_path / "a.txt")

    for ending in (0.0, 0.3, 0.9):

        def stop(done: float, text: str, ending: float = ending) -> None:
            if done >= ending:
                raise Cancelled

        with pytest.raises(Cancelled):
            save_interactive_page(bag(), tmp_path / "a.html", progress=stop, backend="cpu")
    assert list(tmp_path.iterdir()) == []


def test_progress_goes_on_and_never_back(tmp_path: Path) -> None:
    seen: list[float] = []
    path = tmp_path / "a.html"
    save_interactive_page(bag(), path, progress=lambda done, _: seen.append(done), backend="cpu")
    assert seen == sorted(seen)
    # The pictures, which take longest, are told as they are drawn.
    assert len({done for done in seen if 0.8 <= done < 1}) > 4


def test_one_of_two_that_left_together_is_hidden_and_the_other_is_shown(tmp_path: Path) -> None:
    # Two that hook into each other, so that neither leaves alone.
    labels = np.zeros((8, 10, 10), np.uint8)
    labels[1:6, 2, 2:5], labels[[1, 5], 2:5, 2:5] = 1, 1
    labels[3:8, 7, 2:5], labels[[3, 7], 3:8, 2:5] = 2, 2
    session = nu.Session(labels * np.float32(300), labels)
    session.direction = "-z"
    session.unpack(1)
    assert set(session.poses) == {1, 2}
    session.hide([2])
    path = save_interactive_page(session, tmp_path / "a.html", backend="cpu")
    assert [one["id"] for one in told(path.read_text("utf-8"))["objects"]] == [1]
