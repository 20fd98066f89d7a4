"""Films: playable, of the right size and length, whole or not there at all."""

import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image
from scipy.linalg import polar
from scipy.ndimage import binary_dilation

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.view import View
from napari_unpack.io import movie, movies
from napari_unpack.io.headless import frame_bag, packed_copy, snapshot, unpack_in_order
from napari_unpack.io.images import straight_bytes
from napari_unpack.io.movies import movie_writer, turned
from napari_unpack.rendering.compose import scene_image
from napari_unpack.session import Session
from napari_unpack.session.framing import contained, fitted
from napari_unpack.session.measurements import SurfacePoint


@pytest.fixture
def session() -> Any:
    """Three boxes in a row along x, looked at along x, in air."""
    labels = np.zeros((20, 22, 40), np.uint16)
    for i in (1, 2, 3):
        labels[4:16, 4:18, 12 * i - 8 : 12 * i + 2] = i
    volume = np.where(labels > 0, 1500, 0).astype(np.uint16)
    made = Session(volume, labels)
    made.backend = "cpu"
    return made


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_has_its_size_and_every_flight(tmp_path: Path, session: Any, suffix: str) -> None:
    told: list[float] = []
    path = movie(
        session,
        tmp_path / f"film{suffix}",
        count=2,
        size=(101, 120),
        fps=10,
        seconds=0.5,
        backend="cpu",
        progress=lambda fraction, text: told.append(fraction),
    )
    frames = iio.imread(path, index=None) if suffix == ".gif" else iio.imread(path)
    # 0.6 s of rest, two flights of 0.5 s with 0.12 s of rest after each, 1.2 s of rest.
    assert frames.shape[1:3] == (100, 120)
    if suffix == ".mp4":
        assert len(frames) == 6 + 2 * (5 + 1) + 12
    else:
        assert len(frames) > 5, "GIF joins equal frames"
    first, last = frames[0].astype(int), frames[-1].astype(int)
    background = np.median(first.reshape(-1, first.shape[-1]), axis=0)
    assert (np.abs(first - background).max(-1) > 40).sum() > 200, "the bag is there"
    assert (np.abs(first - last).max(-1) > 40).sum() > 100, "something has moved"
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert [p.name for p in tmp_path.iterdir()] == [f"film{suffix}"]


def test_a_flight_shorter_than_the_cameras_way_does_not_let_the_film_jump(
    tmp_path: Path, session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    heights: list[float] = []

    def noted(_scene: Any, camera: Any, size: tuple[int, int], *_: Any) -> np.ndarray:
        heights.append(camera.height)
        return np.zeros((*size, 4), np.float32)

    monkeypatch.setattr(movies, "scene_image", noted)
    path = movie(session, tmp_path / "film", 1, (60, 80), 25, 0.1, "cpu")
    # 0.6 s of rest, 0.35 s until the camera stands, 0.12 s of rest, 1.2 s at the end.
    assert len(list(path.iterdir())) == 15 + 9 + 3 + 30
    # Where nothing moves one image is made.
    before, *gliding, after, last = heights
    assert len(gliding) == 9
    assert before != after == last
    assert gliding[-1] == after


def test_cancel_is_asked_before_every_frame_and_the_bar_moves_with_each(
    tmp_path: Path, session: Any
) -> None:
    told: list[tuple[int, float]] = []

    def tell(fraction: float, _text: str) -> None:
        told.append((len(list(tmp_path.rglob("*.png"))), fraction))

    movie(session, tmp_path / "film", 2, (64, 64), 10, 0.5, "cpu", progress=tell)
    written = [frames for frames, _ in told]
    assert written[-1] == 6 + 2 * (5 + 1) + 12
    assert max(after - before for before, after in pairwise(written)) == 1
    # One frame rests after each flight, for which the bar has no room.
    furthest = [max(f for n, f in told if n == k) for k in range(written[-1])]
    assert sum(after > before for before, after in pairwise(furthest)) >= written[-1] - 1 - 2


def test_filming_leaves_the_session_as_it_was(tmp_path: Path, session: Any) -> None:
    session.unpack(1)
    before = dict(session.states), session.camera, session.hues
    movie(session, tmp_path / "a.mp4", 1, (64, 64), 5, 0.4, "cpu")
    assert (dict(session.states), session.camera, session.hues) == before
    assert not session.animated


def test_cancelling_leaves_no_file(tmp_path: Path, session: Any) -> None:
    class Enough(Exception):
        """The person pressed Cancel."""

    def stop(fraction: float, text: str) -> None:
        if fraction > 0.3:
            raise Enough

    with pytest.raises(Enough):
        movie(session, tmp_path / "a.mp4", None, (64, 64), 5, 0.4, "cpu", progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("film.avi", {}, r"must end in .mp4 or .gif.*got 'film.avi'"),
        ("film.mp4", {"size": (1, 64)}, "size, fps and seconds must be positive"),
        (
            "film.mp4",
            {"size": (10**5, 10**5)},
            "a movie of 100000 x 100000 pixels needs 4,700.0 GB",
        ),
        ("film", {"size": (10**5, 10**6)}, "a movie of 1000000 x 100000 pixels needs 12,000.0 GB"),
        ("film.mp4", {"count": 0}, "count, size, fps and seconds must be positive, got 0"),
        ("film.mp4", {"count": -1}, "count, size, fps and seconds must be positive, got -1"),
        ("film.mp4", {"fps": 0}, "size, fps and seconds must be positive"),
        ("film.mp4", {"seconds": -1.0}, "size, fps and seconds must be positive"),
        ("film.mp4", {"seconds": float("inf")}, "size, fps and seconds must be positive"),
    ],
)
def test_bad_films_are_refused(
    tmp_path: Path, session: Any, name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        movie(session, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_twin_takes_over_what_is_seen_but_has_everything_packed(session: Any) -> None:
    session.direction = "+y"
    session.hide([3])
    session.apply_hues({1: 0.125})
    session.unpack(1)
    other = packed_copy(session)
    assert [state.value for state in other.states.values()] == ["packed", "packed", "hidden"]
    assert other.hues == session.hues
    assert other.direction == (0.0, 1.0, 0.0)
    assert other.volume is session.volume


def test_pictures_and_films_show_what_was_measured_where_it_is_now(session: Any) -> None:
    """On the object it is of, wherever that is, and nowhere between objects that stand apart."""
    session.view = View((1.0, 0.0, 0.0))
    session.apply_hues({1: 0.0, 2: 0.65, 3: 0.65})
    camera = frame_bag(session, (360, 480))
    # Along the front of the second box, and from there to the third.
    inside = [SurfacePoint(2, (4.0, 6.0, 18.0)), SurfacePoint(2, (4.0, 15.0, 24.0))]
    session.measurements.add(inside)
    session.measurements.add([SurfacePoint(2, (4.0, 8.0, 18.0)), SurfacePoint(3, (4.0, 8.0, 32.0))])

    def yellow(shown: Any, time: float | None = None, at: Any = camera) -> np.ndarray:
        rgb = scene_image(shown.scene(), at, (360, 480), time, "cpu")[..., :3]
        return (rgb[..., 0] > 0.8) & (rgb[..., 1] > 0.7) & (rgb[..., 2] < 0.65)

    def drawn(points: np.ndarray, lit: np.ndarray) -> bool:
        spots = np.rint(np.linspace(points[0], points[1], 9)).astype(int)
        # Lines are little more than a pixel wide, and numbers may lie over a part of one.
        return bool(binary_dilation(lit)[tuple(spots.T)].mean() > 0.7)

    first, second = (camera.project(m.ends, (360, 480)) for m in session.measurements)
    lit = yellow(session)
    assert drawn(first, lit)
    assert drawn(second, lit)
    # A film of the session begins with the same, and a switch leaves it out of both.
    film = packed_copy(session)
    film.look(camera)
    assert drawn(first, yellow(film))
    session.measurements.shown = False
    assert not yellow(session).any()
    assert not yellow(snapshot(session)).any()
    session.measurements.shown = True

    film.animated = True
    film.unpack([2])
    (flight,) = film.flights.values()
    part = flight.start + 0.35 * flight.seconds
    pose = flight.pose(part, camera).pivot_from_world(film.boxes.center(2, film.spacing))
    flying = camera.pixels(transform_points(pose, first_ends(session)), (360, 480))
    assert np.abs(flying - first).max() > 5
    lit = yellow(film, part)
    assert drawn(flying, lit)
    assert not drawn(second, lit)
    film.land(2)
    film.hide([2])
    assert not yellow(film).any()


def first_ends(session: Any) -> np.ndarray:
    """Return the points of the first measurement, mm."""
    return next(iter(session.measurements)).ends


def test_unpacking_in_order_takes_the_front_first(session: Any) -> None:
    # Looking along +x, objects leave along -x: the box with the smallest x is in front.
    session.direction = "-x"
    assert list(unpack_in_order(session)) == [(1,), (2,), (3,)]
    assert list(unpack_in_order(session)) == []


def test_a_framed_session_has_room_for_all(session: Any) -> None:
    camera = frame_bag(session, (300, 400))
    assert session.canvas_size == (300, 400)
    assert camera is session.camera
    assert camera.height == pytest.approx(session.slots.height_mm)


def test_a_film_has_the_layout_of_the_window(tmp_path: Path, session: Any) -> None:
    window, size = (240, 400), (120, 160)
    path = movie(
        session, tmp_path / "film", None, size, 2, 0.5, "cpu", decorations=(), window=window
    )
    frames = [iio.imread(file).astype(int) for file in sorted(path.iterdir())]
    session.canvas_size = window

    def seen() -> Any:
        camera = contained(fitted(session), window, size)
        # All that the window shows is in the picture, which is less wide.
        assert camera.height == pytest.approx(fitted(session).height * 1.25)
        image = scene_image(session.scene(), camera, size, backend="cpu")
        return straight_bytes(image[..., :3])

    np.testing.assert_array_equal(frames[0], seen())
    fits = {round(fitted(session).height, 6)}
    for _ in session.ids:
        session.unpack(1)
        fits.add(round(fitted(session).height, 6))
    np.testing.assert_array_equal(frames[-1], seen())
    # There is a step in it: the film has drawn back.
    assert len(fits) > 1


def test_a_film_shows_the_steps_of_a_person_and_goes_on(tmp_path: Path, session: Any) -> None:
    """Their order, slots and hands, as the window shows them; then what is left."""
    window, size = (240, 400), (120, 160)
    session.canvas_size, session.direction = window, "-x"
    session.force_unpack(3)
    session.unpack([1])
    session.place(1, replace(session.poses[1], center=session.poses[1].center * 0.9))

    def frames(name: str, count: int | None = None) -> list[np.ndarray]:
        asked = (count, size, 2, 0.5, "cpu")
        path = movie(session, tmp_path / name, *asked, decorations=(), window=window)
        return [iio.imread(file) for file in sorted(path.iterdir())]

    def seen() -> np.ndarray:
        camera = contained(fitted(session), window, size)
        return straight_bytes(scene_image(session.scene(), camera, size, backend="cpu")[..., :3])

    so_far, whole = frames("steps", count=2), frames("whole")
    np.testing.assert_array_equal(so_far[-1], seen())
    # What was scrubbed back is known as well; a step is a flight and a rest of one frame each.
    session.go_to(1)
    np.testing.assert_array_equal(so_far[2], seen())
    np.testing.assert_array_equal(frames("again", count=2)[-1], so_far[-1])
    session.go_to(3)
    np.testing.assert_array_equal(whole[-1], seen())
    # What is out and hidden takes no step of its own.
    session.hide([3])
    assert packed_copy(session).steps == ((1,), (2,))
    assert len(frames("hidden")) == len(whole) - 2


def test_a_turntable_shows_the_session_as_it_stands_from_all_around(
    tmp_path: Path, session: Any
) -> None:
    session.view = View((0.4, 1.0, 0.0))
    session.unpack(1)
    told: list[float] = []
    path = movie(
        session,
        tmp_path / "round",
        size=(80, 100),
        fps=4,
        backend="cpu",
        kind="turntable",
        turn_seconds=2.0,
        progress=lambda fraction, text: told.append(fraction),
    )
    files = sorted(p.name for p in path.iterdir())
    assert files == [f"frame-{k:05d}.png" for k in range(1, 9)]
    frames = [iio.imread(path / name).astype(int) for name in files]
    assert {frame.shape for frame in frames} == {(80, 100, 3)}
    still = snapshot(session)
    still.canvas_size = 80, 100
    # Sprites included, and at every turn of it the bag.
    radius = still.bag.radius_in(np.eye(3))
    camera = replace(fitted(still), height=max(fitted(still).height, 2 * 1.03 * radius))
    first = straight_bytes(scene_image(still.scene(), camera, (80, 100), backend="cpu"))
    np.testing.assert_array_equal(frames[0], first[..., :3])
    assert all(np.abs(a - b).max() > 40 for a, b in pairwise(frames))
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert session.step == 1
    # Where nothing is said: 720 lines, and 25 frames a second.
    usual = movie(session, tmp_path / "usual", kind="turntable", turn_seconds=0.08, backend="cpu")
    names = sorted(p.name for p in usual.iterdir())
    assert (len(names), iio.imread(usual / names[0]).shape) == (2, (720, 960, 3))
    # The same folder may be filmed into again, another may not.
    movie(session, path, size=(8, 8), fps=1, backend="cpu", kind="turntable", turn_seconds=2.0)
    assert len(list(path.iterdir())) == 2
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="holds something else"):
        movie(session, tmp_path / "mine", kind="turntable")
    with pytest.raises(ValueError, match="kind must be unpacking or turntable"):
        movie(session, tmp_path / "x.mp4", kind="slow")


@pytest.mark.parametrize("direction", [(0.3, 1.0, 0.2), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)])
def test_a_turned_camera_goes_once_round(direction: Any) -> None:
    camera = View(direction).camera((10, 10, 10), (1, 1, 1))
    half = turned(camera, np.pi)
    np.testing.assert_allclose(half.rotation @ half.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turned(half, np.pi).rotation, camera.rotation, atol=1e-12)
    assert half.direction @ camera.direction < 0.9
    if abs(direction[1]) < 0.5:
        # Seen along the ground, half a turn shows the other side, upright still.
        np.testing.assert_allclose(half.direction, -camera.direction, atol=1e-12)
        np.testing.assert_allclose(half.up, camera.up, atol=1e-12)


@pytest.mark.parametrize("looking", [(0.3, 0.2, 1.0), (0.1, 1.0, 0.0)])
@pytest.mark.parametrize(
    "linear",
    [np.diag([1.0, -1.0, 1.0]), np.diag([2.0, 1.0, -1.0]), [[1, 0.2, 0], [0, -1, 0.3], [0, 0, 1]]],
)
def test_a_bag_turns_the_same_way_however_its_layer_stands(looking: Any, linear: Any) -> None:
    linear = np.asarray(linear, dtype=float)
    straight = View(looking).camera((10, 10, 10), (1, 1, 1))
    # linear = length x rotation @ stretch, the stretch symmetric.
    rotation, stretch = polar(linear / np.cbrt(abs(np.linalg.det(linear))))
    mirror = np.sign(np.linalg.det(rotation))
    bent = replace(
        straight, rotation=straight.rotation @ (mirror * rotation), stretch=mirror * stretch
    )
    up = linear.T @ [0, -1, 0]
    for angle in (0.4, 3.0):
        shown = turned(bent, angle, up).linear
        wanted = turned(straight, angle).linear @ rotation @ stretch
        np.testing.assert_allclose(shown, wanted, atol=1e-12)


def test_a_gif_keeps_colours_and_what_stands_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    still = np.zeros((64, 96, 3), np.uint8)
    still[8:40, 8:60] = (200, 120, 40)
    still[20:50, 50:90, 2] = np.linspace(40, 250, 40).astype(np.uint8)
    written = []
    # Where it is made, ffmpeg would take the paths for those of numbered pictures.
    making, path = tmp_path / "50%done", tmp_path / "100%%e.gif"
    making.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(making))
    with movie_writer(path, (64, 96), 10) as write:
        for k in range(12):
            frame = still.copy()
            frame[52:60, 6 * k : 6 * k + 8] = rng.integers(60, 255, 3)
            write(frame)
            written.append(frame)
    read = iio.imread(path, index=None)[..., :3].astype(int)
    assert read.shape == (12, 64, 96, 3)
    assert np.abs(read - np.stack(written)).max() <= 8
    assert (read[:, :50] == read[0, :50]).all(), "nothing flickers where nothing moves"
    assert path.stat().st_size < 12 * 1500
    assert {*tmp_path.iterdir()} == {making, path}


@pytest.mark.parametrize(
    ("said", "told"),
    [("unmistakable " * 40, "…(unmistakable ){20,}in "), ("x" * 400, "…x{300} in ")],
)
def test_what_the_encoder_said_is_told_in_whole_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, told: str
) -> None:
    encoder = tmp_path / "ffmpeg"
    encoder.write_text(f"#!/bin/sh\ncat > /dev/null\necho {said} >&2\nexit 1\n")
    encoder.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(encoder))

    def film() -> None:
        with movie_writer(tmp_path / "film.mp4", (16, 24), 10) as write:
            write(np.zeros((16, 24, 3), np.uint8))

    with pytest.raises(OSError, match=f"could not be written: {told}"):
        film()


def test_a_gif_of_many_frames_a_second_has_none_that_browsers_show_for_too_long(
    tmp_path: Path,
) -> None:
    with movie_writer(tmp_path / "film.gif", (16, 24), 60) as write:
        for k in range(60):
            write(np.full((16, 24, 3), 4 * k, np.uint8))
    shown = []
    with Image.open(tmp_path / "film.gif") as film:
        for k in range(film.n_frames):
            film.seek(k)
            shown.append(film.info["duration"])
    # Browsers take a hundredth of a second for ten.
    assert min(shown) >= 20
    assert sum(shown) == pytest.approx(1000, abs=40)
