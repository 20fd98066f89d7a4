"""The command line, on a bag of three boxes."""

import re
import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest
import zarr
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack.cli import Ticker, app
from napari_unpack.io import (
    Scan,
    load_labels,
    load_volume,
    save_measurements_csv,
    save_objects_csv,
    save_scan,
)
from napari_unpack.io.headless import open_scan
from napari_unpack.io.ome_zarr import write_labels_zarr
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.session.framing import fitted
from napari_unpack.session.measurements import SurfacePoint


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    labels = np.zeros((24, 26, 44), np.uint8)
    for i in (1, 2, 3):
        labels[4:20, 4:20, 13 * i - 9 : 13 * i + 1] = i
    noise = np.random.default_rng(0).integers(0, 30, labels.shape)
    volume = (np.where(labels > 0, 1500, 0) + noise).astype(np.uint16)
    save_scan(Scan(volume, (1.0, 1.0, 1.0), labels), tmp_path / "bag.npz")
    return tmp_path / "bag.npz"


def test_help_lists_every_command() -> None:
    result = run("--help")
    assert result.exit_code == 0
    for command in (
        "simulate",
        "segment",
        "train",
        "score",
        "order",
        "render",
        "movie",
        "web",
        "surfaces",
        "batch",
        "open",
        "demo",
        "bench",
    ):
        assert command in result.output
        assert run(command, "--help").exit_code == 0


def test_train_writes_an_oracle_and_refuses_what_has_no_labels(bag: Path) -> None:
    out = bag.with_name("mine.npz")
    result = run("train", out, bag, bag, bag)
    assert result.exit_code == 0, result.output
    assert "9 objects" in result.output
    assert "100%  Learning from 9 objects" in result.stderr
    assert nu.Oracle.load(out).bad is not None
    np.save(bag.with_name("bare.npy"), np.ones((4, 4, 4)))
    bare = run("train", out, bag.with_name("bare.npy"))
    assert bare.exit_code == 1
    assert "needs labels" in bare.output
    few = run("train", out, bag)
    assert few.exit_code == 1
    assert "at least 8" in few.output
    assert "must end in .npz" in run("train", bag.with_name("mine.txt"), bag).output


def test_order_prints_who_leaves_when(bag: Path) -> None:
    result = run("order", bag, "--direction", "+x", "--backend", "cpu")
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.stdout.splitlines()]
    assert [row[:2] for row in rows[1:]] == [["1", "3"], ["2", "2"], ["3", "1"]]
    # 16 x 16 x 10 voxels of 1 mm3.
    assert rows[1][-2] == "2.6"
    numbers = run("order", bag, "--direction", "0,0,-1", "--count", 1, "--backend", "cpu")
    assert [line.split()[:2] for line in numbers.stdout.splitlines()[1:]] == [["1", "1"]]


def test_order_tells_densities_of_a_scan_scaled_to_one_with_two_digits(bag: Path) -> None:
    labels = load_volume(bag).labels
    volume = np.where(labels > 0, 0.508, 0.0).astype(np.float32)
    save_scan(Scan(volume, (1.0, 1.0, 1.0), labels), bag)
    result = run("order", bag, "--direction", "+x", "--backend", "cpu")
    assert result.exit_code == 0, result.output
    assert [line.split()[-1] for line in result.stdout.splitlines()[1:]] == ["0.51"] * 3


def test_surfaces_are_of_all_objects_or_of_those_asked_for(bag: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    out = bag.with_name("parts.glb")
    result = run("surfaces", bag, out)
    assert result.exit_code == 0, result.output
    assert sorted(trimesh.load_scene(out).geometry) == ["Object 1", "Object 2", "Object 3"]
    one = run("surfaces", bag, bag.with_name("one.stl"), "--objects", "2")
    assert one.exit_code == 0, one.output
    mesh = trimesh.load_mesh(bag.with_name("one.stl"))
    assert mesh.volume == pytest.approx(2560, rel=0.01)
    np.testing.assert_allclose(mesh.center_mass, (21.5, 11.5, -11.5), atol=0.1)
    for strange in ("2,x", "²"):
        refused = run("surfaces", bag, out, "--objects", strange)
        assert "must be IDs such as 1,4" in refused.output
    assert "surfaces must end in" in run("surfaces", bag, bag.with_name("parts.step")).output


def test_web_writes_a_page_with_every_object(bag: Path) -> None:
    out = bag.with_name("page.html")
    result = run("web", bag, out, "--direction", "+x", "--backend", "cpu")
    assert result.exit_code == 0, result.output
    # The last of the row leaves first.
    rows = re.findall(r'<tr data-id="(\d)">', out.read_text("utf-8"))
    assert rows == ["3", "2", "1"]
    assert "must end in .html" in run("web", bag, bag.with_name("page.pdf")).output


def test_render_writes_a_picture_with_every_object(bag: Path) -> None:
    out = bag.with_name("bag.png")
    drawn = run("render", bag, out, "--size", 90, 120, "--unpacked", 1, "--backend", "cpu")
    assert drawn.exit_code == 0, drawn.output
    picture = iio.imread(out)
    assert picture.shape == (90, 120, 4)
    assert (picture[..., 3] == 255).all()
    assert (picture[..., :3].max(-1) > 90).sum() > 300


@pytest.mark.parametrize("before", [2, 0])
def test_a_picture_of_a_saved_session_shows_all_that_is_out(bag: Path, before: int) -> None:
    session = open_scan(load_volume(bag), (1.0, 0.0, 0.0), "+x", backend="cpu")
    session.canvas_size = (90, 270)
    for _ in range(before):
        session.unpack(1)
    session.look(fitted(session))
    saved, out = nu.save_session(session, bag.with_name("wide.unpack")), bag.with_name("seen.png")
    more = ("--unpacked", 2 - before, "--backend", "cpu")
    assert run("render", saved, out, "--size", 90, 90, *more).exit_code == 0
    seen = (iio.imread(out)[..., :3].max(-1) > 90).any(0)
    assert (np.diff(seen).sum(), seen[0], seen[-1]) == (6, False, False)


def test_movie_writes_a_film(bag: Path) -> None:
    out = bag.with_name("bag.mp4")
    result = run("movie", bag, out, "--size", 64, 64, "--fps", 5, "--count", 1, "--backend", "cpu")
    assert result.exit_code == 0, result.output
    assert iio.imread(out).shape[1:] == (64, 64, 3)
    assert "100%" in result.stderr


def test_segment_and_score(bag: Path) -> None:
    out = bag.with_name("found.npz")
    result = run("segment", bag, out, "--csv", bag.with_name("objects.csv"))
    assert result.exit_code == 0, result.output
    assert "objects" in result.stdout
    assert load_volume(out).volume.shape == (24, 26, 44)
    assert bag.with_name("objects.csv").read_text().startswith("id,voxels")
    np.save(bag.with_name("bare.npy"), load_volume(bag).volume)
    result = run("segment", bag.with_name("bare.npy"), bag.with_name("again.npz"))
    assert "note: bare.npy: it gives no voxel size: 1 mm was assumed" in result.stderr
    # A session made of such a file tells it too.
    again = open_scan(load_volume(bag.with_name("again.npz")), (1, 0, 0))
    kept = nu.save_session(again, bag.with_name("kept.unpack"))
    assert "note: kept.unpack: it gives no voxel size" in run("order", kept).stderr
    result = run("score", bag, bag)
    assert result.exit_code == 0, result.output
    lines = {line.split()[0]: line.split(maxsplit=2)[1:] for line in result.stdout.splitlines()}
    assert lines["f1"] == ["1.0000", "objects matched at IoU > 0.5"]
    kinds = bag.with_name("kinds.csv")
    kinds.write_text("id,kind\n1,bottle\n2,box\n3,box\n")
    result = run("score", bag, bag, "--table", kinds, "--boundary")
    rows = [line.split() for line in result.stdout.splitlines()[-4:]]
    assert rows[0][:4] == ["group", "objects", "found", "found_75"]
    assert [row[:3] for row in rows[1:]] == [
        ["bottle", "1", "100%"],
        ["box", "2", "100%"],
        ["all", "3", "100%"],
    ]
    result = run("score", bag, bag, "--table", kinds, "--by", "colour")
    assert result.exit_code == 1
    assert "must have a column 'colour'" in result.stderr


def test_labels_can_come_from_another_file(bag: Path) -> None:
    labels, _ = load_labels(bag)
    np.save(bag.with_name("one.npy"), (labels > 0).astype(np.uint8))
    result = run("order", bag, "--labels", bag.with_name("one.npy"), "--backend", "cpu")
    assert len(result.stdout.splitlines()) == 2
    np.save(bag.with_name("other.npy"), labels[1:])
    result = run("order", bag, "--labels", bag.with_name("other.npy"))
    assert result.exit_code == 1
    assert "labels must have the volume's shape" in result.stderr


def test_mistakes_get_a_sentence_and_no_traceback(bag: Path, tmp_path: Path) -> None:
    for arguments, message in [
        (("order", tmp_path / "nowhere.npz"), "error: no such file"),
        (("order", bag, "--direction", "sideways", "--backend", "cpu"), "error: direction must be"),
        (("order", bag, "--direction", "1,2", "--backend", "cpu"), "error: direction must be"),
        (
            ("movie", bag, tmp_path / "a.avi", "--backend", "cpu"),
            "error: a movie must end in .mp4 or .gif",
        ),
        # Before the long work: there is nothing to be opened.
        (
            ("render", __file__, tmp_path / "a.png", "--size", 10**6, 10**6),
            "error: a picture of 1000000 x 1000000 pixels needs 120,000.0 GB of memory",
        ),
        (
            ("movie", __file__, tmp_path / "a.mp4", "--size", 10**6, 10**6),
            "error: a movie of 1000000 x 1000000 pixels needs 470,000.0 GB of memory",
        ),
        (("render", bag, tmp_path / "no" / "a.png", "--backend", "cpu"), "error: no folder"),
        (("render", bag, tmp_path / "a.jpg"), "a.jpg: the output must end in .png"),
        (("simulate", tmp_path / "a.foo"), "a.foo: the output must end in .npz"),
        (("segment", bag, tmp_path / "a"), "the output must end in .npz"),
        (("order", bag, "--backend", "vulkan"), "error: backend must be"),
        (("order", bag, "--at", "t=²"), "error: --at must be like c=1"),
        (("simulate", tmp_path / ".npz"), ".npz is a suffix alone: give the output a name"),
        (("segment", bag, tmp_path / ".nii.gz"), ".nii.gz is a suffix alone"),
    ]:
        result = run(*arguments)
        assert result.exit_code == 1, (arguments, result.output)
        assert message in result.stderr
        assert "Traceback" not in result.output
    assert run("order", bag, "--count", -2).exit_code == 2
    for retired in ("--method", "--judge"):
        refused = run("segment", bag, tmp_path / "a.npz", retired, "affinity")
        assert refused.exit_code == 2
        assert f"No such option: {retired}" in refused.stderr


def test_a_simulated_bag_knows_what_its_objects_are(tmp_path: Path) -> None:
    out = tmp_path / "bag.npz"
    result = run("simulate", out, "--shape", 40, 48, 56, "--count", 2, "--spacing", "1 1 2")
    assert result.exit_code == 0, result.output
    table = [line.split(",") for line in out.with_suffix(".csv").read_text().splitlines()]
    names = {int(row[0]): row[table[0].index("name")] for row in table[1:]}
    assert names
    found = load_volume(out)
    assert (found.names, found.spacing) == (names, (1, 1, 2))
    listed = run("order", out, "--backend", "cpu").stdout
    assert all(name[:23] in listed for name in names.values())


def test_a_bag_is_not_simulated_whose_table_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "bag.csv").mkdir()
    assert "is a folder" in run("simulate", tmp_path / "bag.npz").output
    assert not (tmp_path / "bag.npz").exists()


def test_help_says_which_commands_take_a_saved_session() -> None:
    for command in ("order", "render", "movie", "table", "web", "surfaces"):
        told = " ".join(run(command, "--help").output.replace("│", " ").split())
        assert "OME-Zarr; or a saved session." in told, command
    for command in ("segment", "batch"):
        told = " ".join(run(command, "--help").output.replace("│", " ").split())
        assert "saved session" not in told, command
        assert "or a session's" not in told, command


def test_pages_are_called_as_their_scan_without_its_suffix(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("SimpleITK")
    titles: list[str] = []
    for page in ("save_objects_page", "save_interactive_page"):
        monkeypatch.setattr(
            f"napari_unpack.io.{page}", lambda _, __, title, *more, **named: titles.append(title)
        )
    scan, labels = bag.with_name("vol.nii.gz"), bag.with_name("vol.labels.nii.gz")
    save_scan(load_volume(bag), scan)
    for command in ("table", "web"):
        done = run(command, scan, bag.with_name("page.html"), "--labels", labels)
        assert done.exit_code == 0, done.output
    assert titles == ["vol", "vol"]


def test_the_demo_says_at_once_that_its_output_can_be_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never() -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr("napari_unpack.viewer.screen.check_screen", never)
    monkeypatch.setenv("UNPACK_VIRTUAL_SCREEN", "1")
    (tmp_path / "notes.txt").write_text("mine")
    for output in (tmp_path / "notes.txt", tmp_path / "notes.txt" / "pictures"):
        refused = run("demo", "--output", output)
        assert refused.exit_code == 1
        assert "cannot be a folder, as" in refused.output
        assert "notes.txt is a file" in refused.output
    assert (tmp_path / "notes.txt").read_text() == "mine"
    # Nothing is made before there are pictures.
    for output in (tmp_path / "pictures", tmp_path):
        assert isinstance(run("demo", "--output", output).exception, AssertionError)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_demo_hands_its_options_to_the_widgets(monkeypatch: pytest.MonkeyPatch) -> None:
    got: list[Any] = []
    module = ModuleType("napari_unpack.demo")
    module.run = lambda *args: got.append(args)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "napari_unpack.demo", module)
    assert run("demo", "a.npz", "--labels", "b.npz", "--output", "out", "--seed", 3).exit_code == 0
    assert run("demo").exit_code == 0
    assert got == [
        (Path("a.npz"), Path("b.npz"), Path("out"), 3, False),
        (None, None, Path("demo-output"), 0, False),
    ]


def test_progress_is_one_line_a_step_and_not_one_a_count(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tell = Ticker()
    for i in range(100):
        tell(0.3 + i / 10_000, f"Splitting: {i} objects")
    tell(0.8, "Joining")
    assert capsys.readouterr().err.splitlines() == [" 30%  Splitting: 0 objects", " 80%  Joining"]


def test_a_saved_session_is_taken_where_a_volume_is(bag: Path) -> None:
    scan = load_volume(bag)
    session = nu.Session(scan.volume, scan.labels)
    session.direction = "+x"
    session.unpack(2)
    saved = nu.save_session(session, bag.with_name("bag.unpack"))
    result = run("order", saved, "--backend", "cpu")
    assert result.exit_code == 0, result.output
    rows = [line.split()[:2] for line in result.stdout.splitlines()]
    assert rows[1:] == [["1", "3"], ["2", "2"], ["3", "1"]]
    some = run("order", saved, "--backend", "cpu", "--count", 1)
    # Of what is out already as well.
    assert [line.split()[:2] for line in some.stdout.splitlines()[1:]] == rows[1:2]
    out = bag.with_name("now.png")
    assert run("render", saved, out, "--size", 60, 80, "--backend", "cpu").exit_code == 0
    assert iio.imread(out).shape == (60, 80, 4)
    for wrong, why in (
        (("order", saved, "--labels", bag), "a session has labels of its own"),
        (("render", saved, out, "--at", "t=99"), "one channel and time point: leave --at out"),
        (("open", saved, "--scan", "foo"), "bag.unpack is one session: leave --scan out"),
    ):
        refused = run(*wrong)
        assert (refused.exit_code, why in refused.output) == (1, True)
    film = bag.with_name("frames")
    how = ("--turntable", "--turn-seconds", 1, "--fps", 2, "--size", 40, 60, "--backend", "cpu")
    filmed = run("movie", saved, film, *how)
    assert filmed.exit_code == 0, filmed.output
    assert len(list(film.iterdir())) == 2


def test_the_table_is_written_as_a_page_and_as_csv(bag: Path) -> None:
    for name in ("table.html", "table.csv"):
        result = run("table", bag, bag.with_name(name), "--backend", "cpu")
        assert result.exit_code == 0, result.output
        assert "Object 2" in bag.with_name(name).read_text(encoding="utf-8")
    assert run("table", bag, bag.with_name("table.txt")).exit_code == 1


def test_tables_of_a_session_have_what_those_of_the_panel_have(bag: Path) -> None:
    """Notes and flags with the objects, and what was measured in a file of its own."""
    scan = load_volume(bag)
    session = nu.Session(scan.volume, scan.labels, scan.spacing)
    session.annotations.set_note(2, "a note")
    session.measurements.add([SurfacePoint(1, (4.0, 4.0, 4.0)), SurfacePoint(1, (4.0, 19.0, 4.0))])
    saved = nu.save_session(session, bag.with_name("bag.unpack"))
    written, wanted = bag.with_name("cli.csv"), bag.with_name("panel.csv")
    save_objects_csv(session, wanted)
    assert run("table", saved, written).exit_code == 0
    assert written.read_text() == wanted.read_text()
    assert "a note" in written.read_text()
    save_measurements_csv(session, wanted)
    assert run("table", saved, written, "--measurements").exit_code == 0
    assert written.read_text() == wanted.read_text()
    assert "15" in written.read_text()
    assert run("table", saved, bag.with_name("a.html"), "--measurements").exit_code == 1
    assert "nothing was measured" in run("table", bag, written, "--measurements").stderr


def test_steps_of_the_demo_are_lines_of_their_own_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from napari_unpack.demo import Steps

    tell = Steps()
    for fraction in (0.0, 0.5):
        tell(fraction, "Unpacking")
    # What else is said meanwhile, such as napari's notices, begins a line.
    assert capsys.readouterr().out.split("] ")[1:] == ["Unpacking\n"]
    tell(0.0, "Inspecting")
    tell.done("Finished")
    assert capsys.readouterr().out.count("\n") == 2


def test_an_output_that_is_the_input_or_cannot_be_written_is_refused_before_the_work(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*args: object, **settings: object) -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr(nu, "segment", never)
    link = bag.with_name("link.npz")
    link.symlink_to(bag)
    wide = bag.with_name("wide.npy")
    np.save(wide, np.ones((4, 4, 4), np.float64))
    save_scan(Scan(np.ones((4, 4, 4), np.uint8), (1, 1, 1)), bag.with_name("twice.labels.mha"))
    locked = bag.with_name("locked.npz")
    locked.write_bytes(b"")
    locked.chmod(0o444)
    before = bag.read_bytes()
    usage = SimpleNamespace(free=1000)
    monkeypatch.setattr("napari_unpack.atomic.shutil.disk_usage", lambda _: usage)
    for source, output, sentence in (
        (bag, bag.parent / "none" / "found.npz", "no folder"),
        (bag, bag.with_name("found.nii.gz"), "1 kB free: free some, or choose another folder"),
        (bag, bag, "is the input and would be overwritten"),
        (bag, link, "is the input and would be overwritten"),
        (bag, locked, "is read-only"),
        (wide, bag.with_name("wide.tif"), "must be uint8, uint16 or float32, got float64"),
        # Its labels go into a file beside it.
        (
            bag.with_name("twice.labels.mha"),
            bag.with_name("twice.mha"),
            "is the input and would be overwritten",
        ),
    ):
        result = run("segment", source, output)
        assert result.exit_code == 1
        assert sentence in result.output.replace("\n", " ")
    assert bag.read_bytes() == before


def test_a_picture_that_is_the_background_is_not_overwritten(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bag.parent)
    for command, name in (("render", "photo.png"), ("movie", "photo.gif")):
        iio.imwrite(name, np.full((30, 40, 3), 90, np.uint8))
        before = Path(name).read_bytes()
        result = run(command, bag, name, "--size", 32, 32, "--background", name)
        assert result.exit_code == 1
        assert "is the input and would be overwritten" in result.output.replace("\n", " ")
        assert Path(name).read_bytes() == before
    # A colour is none, though a folder has its name.
    Path("light").mkdir()
    result = run("movie", bag, "light", "--size", 32, 32, "--background", "light", "--at", "t=1")
    assert "would be overwritten" not in result.output.replace("\n", " ")
    # Nor with the folder that it is in.
    Path("photos").mkdir()
    Path("photo.png").rename("photos/photo.png")
    result = run("movie", bag, "photos", "--background", "photos/photo.png")
    assert "holds the input, which would be lost" in result.output.replace("\n", " ")
    assert Path("photos/photo.png").exists()


def test_a_scan_of_a_pattern_whose_output_was_forgotten_is_not_overwritten(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for work in ("train", "segmentation.segment"):
        monkeypatch.setattr(f"napari_unpack.{work}", lambda *_, **__: pytest.fail("work began"))
    other = bag.with_name("other.npz")
    before = bag.read_bytes()
    shutil.copy(bag, other)
    result = run("train", bag, other)
    assert result.exit_code == 1
    assert "is there and is no oracle: name the oracle" in result.output.replace("\n", " ")
    other.write_bytes(b"")
    assert "is there and is no oracle" in run("train", other, bag).output.replace("\n", " ")
    assert bag.read_bytes() == before
    one, two = bag.with_name("a.zarr"), bag.with_name("b.zarr")
    zarr.create_array(one, data=load_volume(bag).volume, chunks=(16, 16, 16))
    for number in range(2):
        if number:
            # A scan as others write one, with labels inside it.
            shutil.rmtree(two)
            image_zarr(two)
            write_labels_zarr(two / "labels" / "found", np.ones((4, 4, 4), np.int32), (1, 1, 1))
        else:
            zarr.create_array(two, data=load_volume(bag).volume, chunks=(16, 16, 16))
        there = sorted(p.relative_to(two) for p in two.rglob("*"))
        result = run("segment", one, two)
        assert result.exit_code == 1
        assert "is there and holds something else" in result.output.replace("\n", " ")
        assert sorted(p.relative_to(two) for p in two.rglob("*")) == there


@pytest.mark.parametrize("form", [2, 3])
def test_labels_in_zarr_are_replaced_by_newer_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: Any
) -> None:
    """Ours, and those of others that say so, in either form of the standard."""
    image, output = tmp_path / "image.zarr", tmp_path / "labels.zarr"
    image_zarr(image)
    group = zarr.open_group(output, mode="w", zarr_format=form)
    about = {"image-label": {}, "multiscales": [{"datasets": [{"path": "s0"}]}]}
    group.attrs.update(about if form == 2 else {"ome": about})
    group.create_array("s0", data=np.ones((2, 2, 2), np.uint8))

    def segment(*_: object, out: Any, **settings: object) -> SimpleNamespace:
        out[8:30, 8:30, 8:30] = 7
        return SimpleNamespace(objects=pd.DataFrame({"voxels": [1]}))

    monkeypatch.setattr("napari_unpack.segmentation.segment", segment)
    # Twice: what this command has written is replaced too.
    for _ in range(2):
        result = run("segment", image, output)
        assert result.exit_code == 0, result.output
        assert load_labels(output)[0].max() == 7
    assert not (output / "s0").exists()


@pytest.mark.parametrize(("output", "table"), [("a.npz", "a.npz"), ("a.mha", "a.labels.mha")])
def test_a_table_may_not_take_the_place_of_the_labels(
    bag: Path, monkeypatch: pytest.MonkeyPatch, output: str, table: str
) -> None:
    monkeypatch.delattr(nu, "segment")
    folder = bag.parent
    result = run("segment", bag, folder / output, "--csv", folder / table)
    assert result.exit_code == 1
    assert "holds the labels: choose another file for the table" in result.output.replace("\n", " ")


def test_a_segmentation_that_cannot_be_saved_goes_elsewhere_and_says_where(
    bag: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    labels = load_labels(bag)[0]
    objects = pd.DataFrame({"volume": [7.0]}, index=pd.Index([1], name="id"))
    found = SimpleNamespace(labels=labels, objects=objects)
    out = tmp_path / "there"
    out.mkdir()

    def segment(*args: object, **settings: object) -> SimpleNamespace:
        # The folder goes while the work is done.
        out.rmdir()
        return found

    monkeypatch.setattr(nu, "segment", segment)
    result = run("segment", bag, out / "found.nii.gz", "--csv", out / "found.csv")
    assert result.exit_code == 1
    assert "no folder" in result.output
    path, table = [
        Path(line[6:]) for line in result.output.splitlines() if line.startswith("wrote ")
    ]
    np.testing.assert_array_equal(load_labels(path)[0], labels)
    assert pd.read_csv(table)["volume"].tolist() == [7.0]
    for file in (path, table):
        shutil.rmtree(file.parent)


def test_an_oracle_that_cannot_be_saved_goes_elsewhere_and_says_where(
    bag: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    oracle, out = default_oracle(), tmp_path / "there"
    out.mkdir()

    def train(*args: object, **settings: object) -> nu.Oracle:
        out.rmdir()
        return oracle

    monkeypatch.setattr(nu, "train", train)
    result = run("train", out / "mine.npz", bag)
    assert result.exit_code == 1
    assert "no folder" in result.output
    (path,) = [Path(line[6:]) for line in result.output.splitlines() if line.startswith("wrote ")]
    np.testing.assert_array_equal(nu.Oracle.load(path).logistic, oracle.logistic)
    shutil.rmtree(path.parent)


def test_an_output_that_holds_the_input_or_is_a_folder_is_refused_before_the_work(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(nu, "segment")
    refused = run("segment", bag, bag.with_name("found.zarr"))
    assert "a .zarr output needs a Zarr input" in refused.output
    image = bag.with_name("image.zarr")
    zarr.create_array(image / "0", shape=(8, 8, 8), dtype="f4", chunks=(8, 8, 8))[...] = 1.0
    before = sorted(p.relative_to(image) for p in image.rglob("*"))
    (bag.parent / "tables.csv").mkdir()
    (bag.parent / "found.npz").mkdir()
    for arguments, sentence in (
        ((image / "0", image), "holds the input, which would be lost"),
        ((bag, bag.parent / "found.npz"), "is a folder: choose another output"),
        ((bag, bag.parent / "a.npz", "--csv", bag.parent / "tables.csv"), "is a folder"),
    ):
        result = run("segment", *arguments)
        assert result.exit_code == 1
        assert sentence in result.output.replace("\n", " ")
    assert sorted(p.relative_to(image) for p in image.rglob("*")) == before


def test_bags_whose_names_differ_after_a_point_have_tables_of_their_own(tmp_path: Path) -> None:
    for seed in (1, 2):
        out = tmp_path / f"s.{seed}.npz"
        assert (
            run("simulate", out, "--shape", 40, 48, 56, "--count", 2, "--seed", seed).exit_code == 0
        )
    assert sorted(p.name for p in tmp_path.glob("*.csv")) == ["s.1.csv", "s.2.csv"]


def test_the_folder_one_stands_in_is_a_place_like_any_other(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bag.parent)
    result = run("order", ".")
    assert result.exit_code == 1
    assert "empty name" not in result.output


def test_numbers_that_no_library_takes_get_a_sentence(bag: Path, tmp_path: Path) -> None:
    huge = "1" + "0" * 320
    table = tmp_path / "kinds.csv"
    for arguments in (
        ("render", bag, tmp_path / "a.png", "--size", huge, 64),
        ("movie", bag, tmp_path / "a.gif", "--fps", huge),
    ):
        result = run(*arguments)
        assert result.exit_code == 1
        assert isinstance(result.exception, SystemExit)
    for row in ("inf,a", ",a", "1.5,a"):
        table.write_text(f"id,kind\n{row}\n")
        result = run("score", bag, bag, "--table", table, "--by", "kind")
        assert result.exit_code == 1
        assert "whole number in every row of its column 'id'" in result.output.replace("\n", " ")


def image_zarr(path: Path, *steps: dict[str, Any]) -> np.ndarray:
    """Write an image of one box, with what is said of where it lies; return it."""
    volume = np.random.default_rng(0).normal(0, 5, (40, 40, 40)).astype("f4")
    volume[8:30, 8:30, 8:30] += 1000
    group = zarr.open_group(path, mode="w", zarr_format=2)
    group.create_array("0", shape=volume.shape, dtype="f4", chunks=(20, 20, 20))[...] = volume
    axes = [{"name": n, "type": "space", "unit": "millimeter"} for n in "zyx"]
    scale = {"type": "scale", "scale": [2, 1, 1]}
    data = [{"path": "0", "coordinateTransformations": [scale, *steps]}]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": data}]
    return volume


def test_a_damaged_chunk_of_a_zarr_image_is_told_in_a_sentence(tmp_path: Path) -> None:
    image = tmp_path / "image.zarr"
    image_zarr(image)
    (image / "0" / "0.0.0").write_bytes(bytes(range(100)))
    result = run("segment", image, tmp_path / "labels.zarr")
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)
    assert "image.zarr" in result.output
    assert not (tmp_path / "labels.zarr").exists()


@pytest.mark.parametrize("moved", [False, True])
def test_labels_in_zarr_lie_where_the_image_in_zarr_does(tmp_path: Path, moved: bool) -> None:
    image, output = tmp_path / "image.zarr", tmp_path / "labels.zarr"
    image_zarr(image, *[{"type": "translation", "translation": [100, 200, 300]}] * moved)
    assert run("segment", image, output).exit_code == 0
    there, here = load_volume(image).scanner_from_scan, load_volume(output).scanner_from_scan
    if not moved:
        assert there is here is None
        return
    np.testing.assert_array_equal(here, there)
    np.testing.assert_array_equal((here @ [2, 1, 1, 1])[:3], [301, 201, 102])


def test_a_direction_or_a_view_that_cannot_be_is_refused_before_the_work(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*args: object, **settings: object) -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr("napari_unpack.segmentation.segment", never)
    volume = tmp_path / "volume.npz"
    np.savez(volume, volume=load_volume(bag).volume)
    output = tmp_path / "out"
    for arguments, sentence in (
        (("order", volume, "--direction", "sideways"), "direction must be one of"),
        (("render", volume, tmp_path / "a.png", "--view", "0", 0, 0), "direction of looking must"),
        (("batch", volume, "-o", output, "--direction", "sideways"), "direction must be one of"),
    ):
        result = run(*arguments)
        assert result.exit_code == 1
        assert sentence in " ".join(result.output.split())
    # Nor is the folder claimed by a run that could not be.
    assert not output.exists()
