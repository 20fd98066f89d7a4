"""Films: playable, of the right size and length, whole or not there at all."""

from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

from napari_unpack.io import movie
from napari_unpack.io.headless import framed, twin, unpack_in_order
from napari_unpack.session import Session


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
        ("film.avi", {}, r"must end in .mp4 or .gif, got 'film.avi'"),
        ("film.mp4", {"size": (1, 64)}, "size, fps and seconds must be positive"),
        ("film.mp4", {"fps": 0}, "size, fps and seconds must be positive"),
        ("film.mp4", {"seconds": -1.0}, "size, fps and seconds must be positive"),
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
    session.accept_hues({1: 0.125})
    session.unpack(1)
    other = twin(session)
    assert [state.value for state in other.states.values()] == ["packed", "packed", "hidden"]
    assert other.hues == session.hues
    assert other.direction == (0.0, 1.0, 0.0)
    assert other.volume is session.volume


def test_unpacking_in_order_takes_the_front_first(session: Any) -> None:
    # Looking along +x, objects leave along -x: the box with the smallest x is in front.
    session.direction = "-x"
    assert list(unpack_in_order(session)) == [(1,), (2,), (3,)]
    assert list(unpack_in_order(session)) == []


def test_a_framed_session_has_room_for_all(session: Any) -> None:
    camera = framed(session, (300, 400))
    assert session.canvas_size == (300, 400)
    assert camera is session.camera
    assert camera.height == pytest.approx(session.slots.height_mm)
