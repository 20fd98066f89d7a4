"""Session files: what comes back is what was saved, and nothing else is believed."""

from __future__ import annotations

import json
import pathlib
import resource
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import napari_unpack as nu
from napari_unpack.appearance import Decorations
from napari_unpack.io import Scan, save_scan
from napari_unpack.io.headless import open_scan, packed_copy, snapshot
from napari_unpack.io.session_archive import holds_session
from napari_unpack.io.sessions import standing_of
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.segmentation.confidence.features import FEATURES
from napari_unpack.segmentation.confidence.oracle import fit_features
from napari_unpack.segmentation.object_table import confidences
from napari_unpack.session.measurements import SurfacePoint
from tin import tin

SIZE = (72, 96)


def bag():
    """Return volume and labels of nine boxes in three layers."""
    rng = np.random.default_rng(3)
    labels = np.zeros((20, 24, 28), np.int32)
    for k in range(9):
        z, y, x = 1 + 6 * (k // 3), 2 + 7 * (k % 3), 2 + 8 * ((k * 2) % 3)
        labels[z : z + 5, y : y + 6, x : x + 7] = k + 1
    volume = np.where(labels > 0, 900 + 60 * labels, 0) + rng.integers(0, 9, labels.shape)
    return volume.astype(np.int16), labels


def used():
    """Return a session with something of everything."""
    volume, labels = bag()
    facts = pd.DataFrame(
        {"name": [f"Thing {i}" for i in range(1, 10)], "kind": list("abcdefghi")},
        index=pd.Index(range(1, 10), name="id"),
    )
    s = nu.Session(volume, labels, (2.0, 1.0, 1.5), facts)
    s.view = nu.View((1.0, 0.2, 0.1), fov=12.0)
    s.recolor()
    s.rule, s.tolerance, s.max_group_size = "exact", 0.01, 3
    s.take_least_occluded, s.hue_margin, s.locked_hues = True, 0.3, frozenset({2})
    s.unpack(4)
    first = next(iter(s.poses))
    s.place(first, replace(s.poses[first], center=np.array([0.0, 11.0, -7.0]), scale=1.25))
    turned = next(i for i in s.poses if i != first)
    s.turn(turned, s.poses[turned].rotation[[2, 0, 1]])
    s.go_to(5)
    s.go_to(3)
    s.rename(7, "a knife")
    s.clipping = [[(3, 3, 3), (1, 0, 0.5)]]
    s.transfer_function = nu.TransferFunction([(0, 0), (500, 0.1), (1500, 0.7)])
    s.hide([9])
    s.unpack(1)
    s.go_to(4)
    s.go_to(3)
    s.select([3, 4])
    s.canvas_size, s.seconds = (300, 400), 0.7
    return s


def everything(s):
    placements = {
        i: (
            (b.slot, b.rotation.tolist(), b.group, np.asarray(b.direction).tolist()),
            (b.image_mm, b.within, b.turned_mm),
        )
        for i, b in s.state.placements.items()
    }
    poses = {i: (p.center.tolist(), p.rotation.tolist(), p.scale) for i, p in s.poses.items()}
    return {
        "states": {i: state.value for i, state in s.states.items()},
        "order": list(s.state.placements),
        "berths": placements,
        "poses": poses,
        "hues": s.hues,
        "queue": (s.queue.groups, s.queue.restored, s.queue.direction, s.queue.packed),
        "steps": (s.steps, s.step),
        "rules": (s.rule, s.tolerance, s.max_group_size, s.take_least_occluded),
        "look": (s.tint_mode, s.show_unlabelled, s.locked_hues, s.hue_margin),
        "clipping": s.clipping.tolist(),
        "density": s.transfer_function,
        "view": s.view,
        "camera": (s.camera.rotation.tolist(), s.camera.center.tolist(), s.camera.height),
        "size": (s.canvas_size, s.seconds, s.selected, s.direction),
        "log": s.log,
        "spacing": s.spacing.tolist(),
    }


@pytest.fixture(scope="module")
def session():
    return used()


@pytest.fixture
def saved(session, tmp_path):
    return nu.save_session(session, tmp_path / "bag.unpack")


@pytest.mark.parametrize("name", ["bag.unpack", "bag.zip", "bag"])
def test_a_session_comes_back_exactly_as_it_was(session, tmp_path, name):
    path = nu.save_session(session, tmp_path / name)
    assert path.is_dir() == (name == "bag")
    assert holds_session(path)
    found = nu.open_session(path)
    assert everything(found) == everything(session)
    np.testing.assert_array_equal(found.volume, session.volume)
    assert found.volume.dtype == session.volume.dtype
    np.testing.assert_array_equal(found.labels, session.labels)
    pd.testing.assert_frame_equal(found.objects, session.objects)
    assert found.history.done == ()
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]


def test_pictures_are_equal_to_the_pixel_and_unpacking_goes_on_alike(saved):
    session, found = used(), nu.open_session(saved)
    for _ in range(3):
        np.testing.assert_array_equal(
            scene_image(found.scene(), found.overview(), SIZE, backend="cpu"),
            scene_image(session.scene(), session.overview(), SIZE, backend="cpu"),
        )
        assert found.unpack(2) == session.unpack(2)
        assert everything(found)["poses"] == everything(session)["poses"]
    assert found.go_to(0) == session.go_to(0) == 0
    assert everything(found)["states"] == everything(session)["states"]


def test_large_ids_and_an_inspection_come_back(tmp_path):
    volume, labels = bag()
    s = nu.Session(volume.astype(np.float32), labels.astype(np.int64) * 10**9)
    s.direction = "up"
    s.inspect(4)
    found = nu.open_session(nu.save_session(s, tmp_path / "s.unpack"))
    assert [found.label_of(i) for i in found.ids] == [i * 10**9 for i in range(1, 10)]
    assert found.states[4].value == "inspected"
    assert everything(found) == everything(s)


# As of connectomes: no float of 64 bits tells the first two apart.
HUGE = (720575940612453042, 720575940612453043, 10**12 + 1, 2**63 - 1)


@pytest.mark.parametrize("dtype", [np.int64, np.uint64])
def test_ids_that_no_float_holds_come_back(tmp_path, dtype):
    volume, labels = bag()
    given = np.array([0, *HUGE, 1, 2, 3, 4, 5], dtype)[labels]
    s = nu.Session(volume, given)
    s.unpack(3)
    found = nu.open_session(nu.save_session(s, tmp_path / "s.unpack"))
    assert [found.label_of(i) for i in found.ids] == sorted({1, 2, 3, 4, 5, *HUGE})
    assert everything(found) == everything(s)
    pd.testing.assert_frame_equal(found.objects, s.objects)


def test_given_ids_that_a_brush_once_turned_into_floats_are_read(saved):
    def change(manifest):
        objects = manifest["session"]["objects"]
        objects["given_ids"] = [float(i) for i in range(10)]

    assert nu.open_session(changed(saved, change)).ids == nu.open_session(saved).ids


def test_what_is_kept_of_deleted_objects_for_undo_does_not_stop_a_session_from_opening(tmp_path):
    session = used()
    session.restore(list(session.state.placements))
    session.set_style(5, ObjectStyle(cut=(np.zeros(3), np.array([0.0, 0.0, 1.0]))))
    session.set_style(6, ObjectStyle(cut=(np.zeros(3), np.array([0.0, 0.0, 1.0]))))
    session.locked_hues = frozenset({5, 6})
    session.show()
    session.delete(5)
    found = nu.open_session(nu.save_session(session, tmp_path / "bag.unpack"))
    assert set(found.state.styles) == found.locked_hues == {6}
    session.undo()
    assert set(session.state.styles) == {5, 6}


def test_a_session_may_refer_to_its_files(session, tmp_path):
    volume, labels = bag()
    (tmp_path / "data").mkdir()
    there = tmp_path / "data" / "scan.npz"
    save_scan(Scan(volume, (2.0, 1.0, 1.5), labels), there)
    path = tmp_path / "small.unpack"
    nu.save_session(session, path, copy=False, volume_path=there, labels_path=there)
    with zipfile.ZipFile(path) as archive:
        assert set(archive.namelist()) == {"session.json", "picture.png"}
        manifest = json.loads(archive.read("session.json"))
    assert manifest["volume"]["reference"] == "data/scan.npz"
    assert everything(nu.open_session(path)) == everything(session)
    there.rename(tmp_path / "elsewhere.npz")
    with pytest.raises(FileNotFoundError, match=r"its volume in .*scan.npz.* or in Python"):
        nu.open_session(path)
    assert everything(nu.open_session(path, volume, labels)) == everything(session)
    with pytest.raises(ValueError, match="the volume given is not what it was"):
        nu.open_session(path, volume + 1, labels)
    save_scan(Scan(volume + 1, (1, 1, 1), labels), there)
    with pytest.raises(ValueError, match="is not what it was when the session was saved"):
        nu.open_session(path)
    with pytest.raises(ValueError, match="is not what it was"):
        nu.save_session(session, path, copy=False, volume_path=there)
    with pytest.raises(ValueError, match="copy=False needs volume_path"):
        nu.save_session(session, path, copy=False)


@pytest.mark.parametrize("factor", [1, 10**9])
def test_repaired_labels_come_back_with_the_ids_they_have(tmp_path, factor):
    volume, labels = bag()
    s = nu.Session(volume, labels.astype(np.int64) * factor)
    s.delete([3])
    kept = s.merge([7, 1])
    new = s.split(kept, *(tuple(np.argwhere(s.labels == kept)[k]) for k in (0, -1)))
    s.unpack(3)
    found = nu.open_session(nu.save_session(s, tmp_path / "s.unpack"))
    assert new in found.ids
    assert everything(found) == everything(s)
    assert [found.label_of(i) for i in found.ids] == [s.label_of(i) for i in s.ids]
    pd.testing.assert_frame_equal(found.objects, s.objects)
    assert found.unpack(1) == s.unpack(1)


def changed(path, change, member="session.json"):
    """Rewrite one member of a session file."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    if member == "session.json":
        manifest = json.loads(parts[member])
        parts[member] = json.dumps(manifest if (new := change(manifest)) is None else new).encode()
    else:
        parts[member] = change(parts[member])
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in parts.items():
            if data is not None:
                archive.writestr(name, data)
    return path


def setting(*keys, to):
    def change(manifest):
        part = manifest
        for key in keys[:-1]:
            part = part[key]
        part[keys[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (setting("version", to=2), "newer napari-unpack .form 2"),
        (setting("version", to="1"), "version must be a whole number"),
        (setting("format", to="something"), "is no session of napari-unpack"),
        (setting("volume", "shape", to=[20, 24, 29]), "but the session says"),
        (setting("volume", "shape", to=[10**6] * 3), "but the session says"),
        (setting("volume", "dtype", to="|O"), "but the session says"),
        (setting("labels", "sha256", to="0" * 64), "checksum is wrong"),
        (setting("volume", "file", to="../volume.npz"), "must keep its volume as"),
        (setting("volume", to={"reference": "../x.npz"}), "lacks 'shape'"),
        (setting("session", "spacing", to=[1, 0, 1]), "positive"),
        (setting("session", "spacing", to=[1e20, 1, 1]), "up to 1e.12"),
        (setting("session", "spacing", to=[1e11, 1, 1]), "from 1e-09 to 1e.09 mm"),
        (setting("session", "spacing", to=[20000, 1, 1]), "at most 10,000 times"),
        (setting("session", "spacing", to=[10**400, 1, 1]), "3 finite numbers"),
        (setting("session", "camera", "height", to=1e-200), "positive, from 1e-12"),
        (setting("session", "view", "direction", to=[1e308, 0, 0]), "up to 1e.12"),
        (setting("session", "canvas_size", to=[10**11, 2]), "from 1 to 65535"),
        (setting("session", "seconds", to=10**400), "finite number"),
        (setting("session", "objects", "given_ids", to=[]), "those of the labels"),
        (setting("session", "objects", "columns", "mean_density", 0, to=10**400), "hold numbers"),
        (setting("session", "situation", "transfer_function", "points", 0, 0, to=10**400), "malf"),
        (setting("session", "situation", "hues", to={"44": 0.5}), "keyed by IDs"),
        (setting("session", "situation", "hues", to={"1": 7}), "from 0 to 1"),
        (setting("session", "situation", "hidden", to=[99]), "IDs of objects"),
        (setting("session", "situation", "inspected", to=99), "an object in sight"),
        (setting("session", "situation", "out", 0, "slot", to=900), "a slot below 9"),
        (setting("session", "situation", "out", 0, "rotation", to=[[1, 0, 0]] * 3), "rotation"),
        (setting("session", "situation", "out", 0, "group", to=[{}]), "IDs of objects"),
        (setting("session", "situation", "out", to={}), "must be a list"),
        (setting("session", "situation", "ahead", to=[[1]]), "must be an object"),
        (setting("session", "situation", "queue", "groups", to=[[1], [1]]), "each once"),
        (setting("session", "situation", "transfer_function", "points", to=[1]), "malformed"),
        (setting("session", "situation", "direction", to="sideways"), "one of up"),
        (setting("session", "rules", "rule", to="mine"), "one of exact"),
        (setting("session", "camera", "rotation", to=[[2, 0, 0], [0, 1, 0], [0, 0, 1]]), "rotat"),
        (setting("session", "camera", "fov", to=200), "fov"),
        (setting("session", "view", "direction", to=[0, 0, 0]), "direction"),
        (setting("session", "look", "colored", to=1), "true or false"),
        (setting("session", "objects", "ids", to=["a"]), "malformed"),
        (setting("session", "objects", "ids", to=list(range(2, 11))), "those of the labels"),
        (setting("session", "objects", "given_ids", to=[0, 5]), "those of the labels"),
        (setting("session", "objects", "given_ids", to=[0, True]), "IDs from 0 to below 2.*63"),
        (setting("session", "objects", "given_ids", to=[0, 1.5]), "IDs from 0 to below 2.*63"),
        (setting("session", "objects", "given_ids", to=[0, -1]), "IDs from 0 to below 2.*63"),
        (setting("session", "objects", "given_ids", to=[0, 2**63]), "IDs from 0 to below 2.*63"),
        (setting("session", "objects", "slots", to=3), "a whole number from 9"),
        (setting("session", "objects", "columns", "voxels", to=["a"] * 9), "must hold numbers"),
        (setting("session", "log", to=5), "must be a list"),
        (setting("session", to=[]), "must be an object"),
        (lambda manifest: [], "must be an object"),
    ],
)
def test_what_cannot_be_is_refused_with_a_sentence(saved, change, said):
    with pytest.raises(ValueError, match=said):
        nu.open_session(changed(saved, change))


def test_a_reference_may_not_leave_the_folder(saved):
    for bad in ("../secret.npz", "a/../../x.npz", "..\\x.npz"):

        def change(manifest, bad=bad):
            manifest["volume"] = {**manifest["volume"], "reference": bad}
            manifest["volume"].pop("file", None)

        with pytest.raises(ValueError, match="a path that leaves its folder"):
            nu.open_session(changed(saved, change))


@pytest.mark.parametrize(
    "place", [r"\\host\share\x.npz", "//host/share/x.npz", r"\\?\UNC\host\x", r"\/host", "//host"]
)
def test_a_reference_to_another_computer_is_not_even_looked_for(saved, place, monkeypatch):
    def change(manifest):
        manifest["volume"] = {**manifest["volume"], "reference": place}
        manifest["volume"].pop("file", None)

    path = changed(saved, change)
    asked, ask = [], pathlib.Path.stat

    def stat(path, **options):
        asked.append(str(path))
        return ask(path, **options)

    monkeypatch.setattr(pathlib.Path, "stat", stat)
    with pytest.raises(ValueError, match="its volume on another computer"):
        nu.open_session(path)
    assert asked
    assert not [name for name in asked if "host" in name]


def test_a_file_that_is_cut_short_damaged_or_something_else_is_refused(saved, tmp_path):
    whole = saved.read_bytes()
    for length in (0, 10, len(whole) // 3, len(whole) - 30):
        saved.write_bytes(whole[:length])
        with pytest.raises(
            ValueError, match=r"no session, or not whole|damaged, not whole|is empty"
        ):
            nu.open_session(saved)
    damaged = bytearray(whole)
    damaged[whole.index(b"array.npy") + 400] ^= 0xFF
    saved.write_bytes(bytes(damaged))
    with pytest.raises(ValueError, match=r"damaged|not whole|lacks|readable"):
        nu.open_session(saved)
    saved.write_bytes(whole)
    changed(saved, lambda data: data[: len(data) // 2], "volume.npz")
    with pytest.raises(ValueError, match="damaged, not whole"):
        nu.open_session(saved)
    changed(saved, lambda data: None, "volume.npz")
    with pytest.raises(ValueError, match=r"lacks volume.npz"):
        nu.open_session(saved)
    (tmp_path / "other.zip").write_bytes(b"PK\5\6" + bytes(18))
    with pytest.raises(ValueError, match="is no session: it lacks"):
        nu.open_session(tmp_path / "other.zip")
    with pytest.raises(FileNotFoundError, match="no such session"):
        nu.open_session(tmp_path / "nothing.unpack")


def test_a_zip_with_paths_outside_and_a_folder_with_links_are_refused(saved, session, tmp_path):
    with zipfile.ZipFile(saved, "a") as archive:
        archive.writestr("../../evil.txt", "x")
    with pytest.raises(ValueError, match=r"it holds '../../evil.txt'"):
        nu.open_session(saved)
    assert not (tmp_path.parent / "evil.txt").exists()
    folder = nu.save_session(session, tmp_path / "folder")
    (folder / "volume.npz").rename(tmp_path / "away.npz")
    (folder / "volume.npz").symlink_to(tmp_path / "away.npz")
    with pytest.raises(ValueError, match="must be a plain file in its folder, not a link"):
        nu.open_session(folder)


@pytest.mark.parametrize("name", ["bag.unpack", "bag"])
def test_a_full_disk_leaves_the_old_session(session, tmp_path, name):
    path = nu.save_session(session, tmp_path / name)
    before = everything(nu.open_session(path))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6000, hard))
    try:
        with pytest.raises(OSError, match="what was there before is unchanged"):
            nu.save_session(session, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert everything(nu.open_session(path)) == before
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_cancelling_leaves_the_old_session_and_a_folder_of_others_is_not_touched(session, tmp_path):
    path = nu.save_session(session, tmp_path / "s.unpack")
    size = path.stat().st_mtime_ns

    def stop(fraction, text):
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nu.save_session(session, path, progress=stop)
    assert path.stat().st_mtime_ns == size
    assert [p.name for p in tmp_path.iterdir()] == ["s.unpack"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="is there and holds something else"):
        nu.save_session(session, tmp_path / "mine")
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"
    with pytest.raises(FileNotFoundError, match="no folder"):
        nu.save_session(session, tmp_path / "no" / "s.unpack")
    again = nu.save_session(session, tmp_path / "kept")
    nu.save_session(session, again)
    shutil.rmtree(again)


def test_the_picture_in_a_file_is_of_the_moment_it_was_saved_at(tmp_path):
    session = used()
    still = nu.save_session(session, tmp_path / "still")

    def go_on(fraction, text):
        if fraction > 0:
            session.go_to(0)

    moving = nu.save_session(session, tmp_path / "moving", progress=go_on)
    assert session.step == 0
    assert (still / "picture.png").read_bytes() == (moving / "picture.png").read_bytes()
    assert nu.open_session(moving).step == 3


def test_saving_says_how_far_it_is(session, tmp_path):
    told = []
    nu.save_session(session, tmp_path / "s.unpack", progress=lambda f, t: told.append(f))
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
    told.clear()
    nu.open_session(tmp_path / "s.unpack", progress=lambda f, t: told.append(f))
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_background_box_and_scale_come_back(tmp_path):
    session = used()
    picture = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    for background, decorations in ((("#102030,#ffffff"), ["box"]), (picture, ["scale"])):
        session.decorations = Decorations.of(background, decorations)
        nu.save_session(session, tmp_path / "a.unpack")
        back = nu.open_session(tmp_path / "a.unpack").decorations
        assert (back.box, back.scale) == (session.decorations.box, session.decorations.scale)
        wanted = session.decorations.background.paint((9, 7))
        np.testing.assert_array_equal(back.background.paint((9, 7)), wanted)


def test_a_session_tells_how_its_bag_stood_if_that_was_known(session, tmp_path):
    stood = np.array([[0, 0, -1.5, 7], [0.2, 1, 0, -4], [1, 0, 0, 0.1], [0, 0, 0, 1]])
    path = nu.save_session(session, tmp_path / "s.unpack", standing=stood)
    np.testing.assert_array_equal(standing_of(path), stood)
    assert everything(nu.open_session(path)) == everything(session)
    # Files of before do not tell.
    changed(path, lambda manifest: {k: v for k, v in manifest.items() if k != "standing"})
    assert standing_of(path) is None
    assert everything(nu.open_session(path)) == everything(session)
    assert standing_of(nu.save_session(session, path)) is None
    for wrong in (np.ones((4, 4)), np.zeros((4, 4)), np.eye(3), [["a"] * 4] * 4):
        flat = np.asarray(wrong).tolist()
        with pytest.raises(ValueError, match=r"standing|stands"):
            standing_of(changed(path, lambda m, flat=flat: {**m, "standing": flat}))


def test_what_had_to_be_assumed_of_the_scan_comes_back(session, tmp_path):
    told = ("it gives no voxel size: 1 mm was assumed", "it holds two scans: the first was taken")
    bare = Scan(session.volume, (1.0, 1.0, 1.0), np.asarray(session.labels), assumed=told)
    path = nu.save_session(open_scan(bare, (1, 0, 0)), tmp_path / "s.unpack")
    back = nu.open_session(path)
    assert back.assumed == told
    assert packed_copy(back).assumed == told
    with pytest.raises(ValueError, match="assumed must be a list of texts"):
        nu.open_session(changed(path, setting("session", "assumed", to=[1])))
    # Files of before do not tell.
    changed(path, lambda m: {**m, "session": {**m["session"], "assumed": None}})
    assert nu.open_session(path).assumed == ()


def test_where_a_session_begins_in_its_scan_comes_back(session, tmp_path):
    session.first_voxel_mm = np.array([1.0, 2.0, 3.5])
    path = nu.save_session(session, tmp_path / "part.unpack")
    assert nu.open_session(path).first_voxel_mm.tolist() == [1.0, 2.0, 3.5]
    with pytest.raises(ValueError, match="first_voxel_mm"):
        nu.open_session(changed(path, lambda m: {**m, "first_voxel_mm": [1, 2]}))
    # Files of before do not tell.
    changed(path, lambda m: {k: v for k, v in m.items() if k != "first_voxel_mm"})
    assert nu.open_session(path).first_voxel_mm.tolist() == [0, 0, 0]


def test_what_was_done_inside_opened_objects_is_saved_with_them(tmp_path: Path) -> None:
    session = nu.Session(*tin())
    bag = session.opened_bags.open(session, 1)
    # Looking into it is no work.
    assert session.opened_bags.worked_in(session) == {}
    first, second = list(bag.ids)[-2:]
    bag.rename(first, "a coin")
    bag.merge([first, second])
    bag.unpack(1)
    nu.io.save_session(session, tmp_path / "tin.unpack")
    found = nu.io.open_session(tmp_path / "tin.unpack")
    (again,) = found.opened_bags.worked_in(found).values()
    assert found.opened_bags.open(found, 1) is again
    np.testing.assert_array_equal(again.labels, bag.labels)
    np.testing.assert_array_equal(again.volume, bag.volume)
    assert again.states == bag.states
    assert list(again.objects["name"]) == list(bag.objects["name"])
    # Of repaired labels it may be so no more; undo brings it back.
    found.merge([1, 2])
    assert found.opened_bags.worked_in(found) == {}
    found.undo()
    assert found.opened_bags.worked_in(found) == {1: again}
    # Saved once more it is still there.
    nu.io.save_session(found, tmp_path / "again.unpack")
    assert nu.io.open_session(tmp_path / "again.unpack").opened_bags.worked_in(found).keys() == {1}


def test_a_model_of_ones_own_is_saved_with_the_session_it_scored(tmp_path: Path) -> None:
    path, session = tmp_path / "tin.unpack", nu.Session(*tin())
    oracle = fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES))))
    session.use_oracle(oracle, {i: 0.1 * i for i in session.ids})
    inner = session.opened_bags.open(session, 1)
    inner.rename(inner.ids[-1], "a coin")
    nu.save_session(snapshot(session), path)
    found = nu.open_session(path)
    (again,) = found.opened_bags.worked_in(found).values()
    assert found.objects["confidence"].tolist() == session.objects["confidence"].tolist()
    rows = np.random.default_rng(1).normal(size=(9, len(FEATURES)))
    for bag in (found, again):
        assert isinstance(bag.label_editor.oracle, nu.Oracle)
        np.testing.assert_array_equal(bag.label_editor.oracle.scores(rows), oracle.scores(rows))
    # What is repaired then is scored by it.
    found.merge([1, 2])
    (whole,) = {1, 2} & set(found.ids)
    wanted = confidences(found.labels, found.volume, tuple(found.spacing), oracle)[whole]
    assert found.objects["confidence"][whole] == pytest.approx(wanted)
    # Of another version nothing is believed, and all is scored anew; what is damaged is refused.
    with pytest.warns(UserWarning, match="by a model of another version"):
        foreign = nu.open_session(changed(path, setting("model", "format", to="oracle 9")))
    for bag in (foreign, *foreign.opened_bags.worked_in(foreign).values()):
        assert bag.label_editor.oracle is None
        assert bag.objects["confidence"].isna().all()
        assert scored(bag) == confidences(bag.labels, bag.volume, tuple(bag.spacing))
    nu.save_session(session, path)
    damaged = changed(path, setting("model", "arrays", "axes", "shape", to=[2, 2]))
    with pytest.raises(ValueError, match="model is damaged: axes cannot be read"):
        nu.open_session(damaged)
    # A function that no file can hold leaves its numbers.
    session.use_oracle(lambda region: 0.5, dict.fromkeys(session.ids, 0.5))
    found = nu.open_session(nu.save_session(session, path))
    assert set(found.objects["confidence"]) == {0.5}


def scored(session: nu.Session) -> dict[int, float]:
    """Return the confidences once what has none was scored."""
    task = session.label_editor.missing_scores_task()
    assert task is not None
    session.label_editor.take_scores(task.run(lambda *_: None))
    return dict(session.objects["confidence"])


def test_what_the_built_in_model_has_not_scored_yet_is_scored_after_opening(tmp_path: Path) -> None:
    session = nu.Session(*tin())
    session.use_oracle(None, {2: 0.5})
    found = nu.open_session(nu.save_session(session, tmp_path / "a.unpack"))
    wanted = confidences(found.labels, found.volume, tuple(found.spacing))
    assert found.objects["confidence"].isna().sum() == len(found.ids) - 1
    assert scored(found) == wanted | {2: 0.5}
    # What came with the labels is nobody's to replace.
    given = nu.open_session(nu.save_session(nu.Session(*tin()), tmp_path / "b.unpack"))
    assert given.label_editor.missing_scores_task() is None


def test_the_scores_inside_an_object_are_kept_by_the_model_of_the_bag(tmp_path: Path) -> None:
    path, session = tmp_path / "tin.unpack", nu.Session(*tin())
    oracle, other = (
        fit_features(np.random.default_rng(k).normal(size=(40, len(FEATURES)))) for k in (0, 1)
    )
    session.use_oracle(oracle, dict.fromkeys(session.ids, 0.5))
    inner = session.opened_bags.open(session, 1)
    inner.use_oracle(oracle, dict.fromkeys(inner.ids, 0.25))
    inner.rename(inner.ids[-1], "a coin")

    def again() -> nu.Session:
        found = nu.open_session(nu.save_session(session, path))
        (kept,) = found.opened_bags.worked_in(found).values()
        assert list(kept.objects["confidence"]) == list(inner.objects["confidence"])
        return found

    found = again()
    # Written once, and the same one after.
    with zipfile.ZipFile(path) as archive:
        (told,) = json.loads(archive.read("session.json"))["containers"]
    assert "model" not in told
    assert set(found.opened_bags.open(found, 1).objects["confidence"]) == {0.25}
    found.opened_bags.leave(found, 1)
    assert set(found.objects["confidence"]) == {0.5}
    # Not yet scored by the bag's model of now, or by nothing that a file can hold.
    for model in (None, other, lambda region: 0.75):
        inner.use_oracle(model, dict.fromkeys(inner.ids, 0.75))
        (kept,) = (found := again()).opened_bags.worked_in(found).values()
        assert kept.label_editor.oracle is not found.label_editor.oracle


def test_tables_of_pandas_own_types_are_saved_and_names_in_them_change(tmp_path: Path) -> None:
    volume, labels = bag()
    facts = pd.DataFrame(
        {
            "confidence": pd.array([0.5, None, *[0.25] * 7], "Float64"),
            "name": pd.Categorical(list("abacabaca")),
            "kind": pd.array(["cup", None, *["book"] * 7], "string"),
            "whole": pd.Series([np.bool_(True), np.nan, *[False] * 7], range(1, 10), object),
            "key": pd.Series([np.int64(2**60 + 1), None, *range(7)], range(1, 10), object),
        },
        index=range(1, 10),
    )
    s = nu.Session(volume, labels, objects=facts)
    s.rename(1, "something new")
    nu.save_session(s, tmp_path / "a.unpack")
    back = nu.open_session(tmp_path / "a.unpack").objects
    assert list(back["name"])[:3] == ["something new", "b", "a"]
    assert back["confidence"].tolist()[0] == 0.5
    assert np.isnan(back["confidence"].tolist()[1])
    assert back["kind"].tolist()[0] == "cup"
    assert back.loc[2, ["kind", "whole", "key"]].isna().all()
    assert back["whole"].dropna().tolist() == [True, *[False] * 7]
    assert isinstance(back["whole"].tolist()[0], bool)
    assert back["key"].dropna().tolist() == [2**60 + 1, *range(7)]


def test_a_point_on_a_deleted_object_is_one_of_none_saved_or_not(tmp_path: Path) -> None:
    s = nu.Session(*bag())
    s.measurements.add([SurfacePoint(1, (1, 2, 3)), SurfacePoint(2, (3, 5, 3))])
    s.delete(1)
    (told,) = s.measurements
    assert [point.object_id for point in told.points] == [0, 2]
    nu.save_session(s, tmp_path / "a.unpack")
    assert [*nu.open_session(tmp_path / "a.unpack").measurements] == [told]
    s.undo()
    assert next(iter(s.measurements)).objects == {1, 2}


def test_ids_taken_from_the_labels_are_saved_like_any_other(tmp_path: Path) -> None:
    volume, labels = bag()
    s = nu.Session(volume, labels)
    ids = [s.labels[tuple(np.argwhere(labels == i)[0])] for i in (1, 2)]
    assert isinstance(ids[0], np.integer)
    s.force_unpack(ids[0])
    s.locked_hues = {ids[1]}
    s.measurements.add([SurfacePoint(ids[0], (1, 2, 3)), SurfacePoint(0, (3, 5, 3))])
    nu.save_session(s, tmp_path / "a.unpack")
    back = nu.open_session(tmp_path / "a.unpack")
    assert set(back.poses) == {1}
    assert back.locked_hues == {2}
    assert back.state.measurements[0].points[0].object_id == 1


@pytest.mark.parametrize("seconds", [0, -1.0, np.nan, np.inf])
def test_flights_take_a_time_that_a_file_can_hold(seconds: float) -> None:
    s = nu.Session(*bag())
    with pytest.raises(ValueError, match="seconds must be positive and finite"):
        s.seconds = seconds
    assert s.seconds > 0


def test_a_session_that_would_not_open_again_replaces_none_that_does(saved):
    found = nu.open_session(saved)
    # Both are kept as arrays, whatever they come as.
    found.first_voxel_mm, found.scanner_from_scan = [1, 2, 3], np.eye(4).tolist()
    nu.save_session(found, saved)
    found.seconds = 1e300
    with pytest.raises(ValueError, match=r"session\.seconds must be a finite number up to"):
        nu.save_session(found, saved)
    assert nu.open_session(saved).first_voxel_mm.tolist() == [1, 2, 3]
