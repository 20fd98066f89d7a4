"""One session file and several processes, one session and several threads."""

import os
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from napari_unpack.io import open_session, save_session, sessions
from napari_unpack.rendering.compose import scene_image
from napari_unpack.session import Session

LABELS = np.zeros((20, 24, 28), np.uint16)
LABELS[3:9, 3:9, 3:9], LABELS[3:9, 12:20, 3:9], LABELS[12:18, 4:20, 12:26] = 1, 2, 3
VOLUME = (LABELS * 500 + np.arange(LABELS.size).reshape(LABELS.shape) % 7).astype(np.uint16)


@pytest.fixture
def bag() -> Session:
    session = Session(VOLUME, LABELS)
    session.backend = "cpu"
    session.recolor()
    return session


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.parametrize("name", ["bag.unpack", "bag"])
def test_two_processes_that_save_one_session_leave_a_whole_one(
    tmp_path: Path, bag: Session, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Drawn by threads, of which a forked process has none.
    monkeypatch.setattr(sessions, "_picture", lambda *_: b"picture")
    path, names = tmp_path / name, ("first", "second")
    save_session(bag, path)
    children = []
    for word in names:
        child = os.fork()
        if child == 0:
            code = 1
            try:
                bag.rename(1, word)
                for _ in range(6):
                    save_session(bag, path)
                code = 0
            finally:
                os._exit(code)
        children.append(child)
    seen, codes = [], []
    while len(codes) < 2:
        # A folder is replaced file by file to whoever reads it at that moment.
        with suppress(*((ValueError, FileNotFoundError) if name == "bag" else ())):
            seen.append(str(open_session(path).objects["name"][1]))
        done, status = os.waitpid(-1, os.WNOHANG)
        codes += [os.waitstatus_to_exitcode(status)] if done in children else []
    assert set(seen) <= {*names, str(bag.objects["name"][1])}
    assert str(open_session(path).objects["name"][1]) in names
    # One file is always saved; of two folders one may be told that the other came between.
    assert codes == [0, 0] if name == "bag.unpack" else min(codes) == 0
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_scenes_are_drawn_by_any_thread_while_the_session_goes_on(
    tmp_path: Path, bag: Session
) -> None:
    size, drawn = (30, 40), {}
    camera = bag.overview()

    def draw(k: int, scene: object) -> None:
        drawn[k] = scene_image(scene, camera, size, backend="cpu")

    scenes, threads = [], []
    saving = threading.Thread(target=save_session, args=(bag, tmp_path / "bag.unpack"))
    for k in range(4):
        scenes.append(bag.scene())
        threads.append(threading.Thread(target=draw, args=(k, scenes[k])))
        threads[-1].start()
        if k == 0:
            saving.start()
        bag.unpack(1)
    for thread in (*threads, saving):
        thread.join()
    for k, scene in enumerate(scenes):
        alone = scene_image(scene, camera, size, backend="cpu")
        np.testing.assert_array_equal(drawn[k], alone)
    # The three objects left one by one, so that the pictures differ.
    assert len({image.tobytes() for image in drawn.values()}) == 4
    opened = open_session(tmp_path / "bag.unpack")
    assert opened.step in range(4)
