"""Folders that are written anew: nothing that a person put into one goes with what was there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.io.surfaces import save_surfaces


def plates() -> nu.Session:
    labels = np.zeros((8, 10, 10), np.uint8)
    labels[1:3, 2:8, 2:8] = 1
    labels[4:6, 2:8, 2:8] = 2
    return nu.Session(np.where(labels, 1000, 0).astype(np.uint16), labels)


def save_session(path: Path) -> None:
    nu.save_session(plates(), path)


def save_prints(path: Path) -> None:
    pytest.importorskip("trimesh")
    save_surfaces(plates(), path)


def film(path: Path) -> None:
    nu.movie(plates(), path, count=1, size=(32, 32), fps=5, seconds=0.2, backend="cpu")


WRITERS = pytest.mark.parametrize(
    ("write", "own"),
    [(save_session, "scan.npz"), (save_prints, "mine.stl"), (film, "frame-holiday.png")],
    ids=["session", "surfaces", "film"],
)


@WRITERS
def test_a_folder_with_a_file_of_somebodys_own_is_refused(
    tmp_path: Path, write: Callable[[Path], None], own: str
) -> None:
    folder = tmp_path / "out"
    write(folder)
    (folder / own).write_bytes(b"the only copy")
    before = sorted(file.name for file in folder.iterdir())
    with pytest.raises(ValueError, match="holds something else: choose another name"):
        write(folder)
    assert sorted(file.name for file in folder.iterdir()) == before
    assert (folder / own).read_bytes() == b"the only copy"


@WRITERS
def test_what_file_managers_leave_in_it_keeps_nobody_from_saving(
    tmp_path: Path, write: Callable[[Path], None], own: str
) -> None:
    folder = tmp_path / "out"
    write(folder)
    (folder / ".DS_Store").write_bytes(b"?")
    write(folder)
    assert not (folder / ".DS_Store").exists()


def test_a_session_does_not_refer_to_what_saving_it_takes_away(tmp_path: Path) -> None:
    session, folder = plates(), tmp_path / "bag"
    nu.save_session(session, folder)
    kept = folder / "volume.npz"
    before = kept.read_bytes()
    with pytest.raises(ValueError, match="would replace: choose another name"):
        nu.save_session(session, folder, copy=False, volume_path=kept)
    assert kept.read_bytes() == before


@pytest.mark.parametrize("name", ["q.npz", "Q.NII.GZ", "q.zarr"])
def test_a_session_is_no_folder_with_the_name_of_a_volume(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} would be a folder .* end in .unpack or .zip"):
        nu.save_session(plates(), tmp_path / name)
    assert not list(tmp_path.iterdir())
    # Where one is there of old, it is a session like any other.
    nu.save_session(plates(), tmp_path / "q").rename(tmp_path / name)
    nu.save_session(nu.open_session(tmp_path / name), tmp_path / name)
    assert nu.save_session(plates(), tmp_path / "run 2.5").is_dir()
