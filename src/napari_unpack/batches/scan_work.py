"""The work on one scan: read, segment, unpack, and write all that is made of it at once."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from napari_unpack.atomic import check_space, folder_written_atomically
from napari_unpack.batches.inputs import ScanInput
from napari_unpack.batches.memory_needs import check_need
from napari_unpack.batches.object_rows import write_object_rows
from napari_unpack.batches.results import (
    DONE,
    FILM,
    OBJECTS,
    PAGE,
    PICTURE,
    SESSION,
    ScanResult,
    folder_name,
    read_result,
)
from napari_unpack.batches.run_settings import SCANS, Settings, identity, identity_of_settings
from napari_unpack.file_sizes import stored_size
from napari_unpack.io.headless import open_scan, unpack_in_order
from napari_unpack.io.labels_on_volume import scan_with_label_file
from napari_unpack.io.scan import Scan
from napari_unpack.io.sessions import volume_file_of
from napari_unpack.io.volumes import load_volume, printable

if TYPE_CHECKING:
    from napari_unpack.session import Session

LABELS = {"npz": "labels.npz", "zarr": "labels.ome.zarr"}
"""By how they are written."""

PICTURE_SIZE = (480, 640)
"""Height and width, pixels: sharp at the width that the index gives it, on dense screens too."""


@dataclass(frozen=True)
class Place:
    """Where results go, and what a scan may take.

    Parameters
    ----------
    output : Path
        The run's folder.
    settings : Settings
    memory : int, optional
        Bytes that one scan may take; what is free without it.
    large : bool
        As for `load_volume`.
    """

    output: Path
    settings: Settings
    memory: int | None = None
    large: bool = False


def work_on(scan: ScanInput, place: Place, known: Mapping[str, str]) -> ScanResult:
    """Do all that is asked for of a scan; whatever goes wrong becomes the result's reason.

    Parameters
    ----------
    scan : ScanInput
    place : Place
    known : mapping of str to str
        Folders of what is done already, by identity.
    """
    start = perf_counter()
    try:
        found = _worked(scan, place, known)
    except Exception as error:
        # One bad file may stop nobody: its reason goes into the report.
        plain = isinstance(error, ValueError | OSError | ImportError)
        reason = str(error) if plain else f"{type(error).__name__}: {error}"
        found = ScanResult(scan.name, scan.source, "failed", printable(" ".join(reason.split())))
    return found if found.status == "kept" else replace(found, seconds=perf_counter() - start)


def _worked(scan: ScanInput, place: Place, known: Mapping[str, str]) -> ScanResult:
    if not place.large:
        check_need(scan, place.memory)
    data, settings = _loaded(scan, place.large), place.settings
    key = identity(data, settings)
    own = f"{SCANS}/{folder_name(scan.name, key)}"
    # Scans of one content have a folder each; one that was renamed has that of its earlier name.
    done = {one: read_result(place.output / one) for one in (known.get(key, own), own)}
    kept = {one: told for one, told in done.items() if told is not None and told.identity == key}
    where = own if own in kept else known.get(key, own)
    before = kept.get(where)
    if before is not None and os.path.exists(place.output / where / SESSION):
        said = _mended(place.output / where, scan, data, place)
        # It may have been done under another name, or from another place.
        kept_so = replace(before, scan=scan.name, source=scan.source, status="kept")
        return replace(kept_so, notes=(*before.notes, *said))
    if before is not None and before.source != scan.source and os.path.exists(before.source):
        # That is another scan's, of the same content.
        where = own
    start = perf_counter()
    folder = Path(where)
    target = place.output / folder
    check_space(target, data.volume.nbytes // 8 if settings.copies else 0)
    session = open_scan(
        data,
        settings.view,
        settings.direction,
        backend="cpu",
        smallest=settings.smallest,
        grainy=settings.grainy,
    )
    session.queries.occlusion(sure=session.queries.packed)
    blockers = session.queries.blockers()
    _plan(session)
    with folder_written_atomically(target, lambda there: (there / DONE).is_file()) as temporary:
        _write(session, scan, data, settings, temporary)
        write_object_rows(session, blockers, scan.name, temporary / OBJECTS)
        found = ScanResult(
            scan.name,
            scan.source,
            "done",
            folder=folder.as_posix(),
            objects=len(session.ids),
            megabytes=stored_size(temporary) / 1e6,
            notes=tuple(map(printable, data.assumed)),
            identity=key,
            settings=identity_of_settings(settings),
            seconds=perf_counter() - start,
        )
        (temporary / DONE).write_text(json.dumps(found.record(), indent=1), encoding="utf-8")
    return found


def _loaded(scan: ScanInput, large: bool) -> Scan:
    data = load_volume(scan.volume, large=large)
    if scan.labels is not None:
        data = scan_with_label_file(data, scan.labels, large)
    data = replace(data, name=scan.name)
    return data if scan.spacing is None else data.with_spacing(scan.spacing)


def _mended(there: Path, scan: ScanInput, data: Scan, place: Place) -> tuple[str, ...]:
    """Mend what can be; what cannot is said, and the result stays as it is."""
    try:
        _mend(there, scan, data, place)
    except (OSError, ValueError, ImportError) as error:
        return (printable(" ".join(str(error).split())),)
    return ()


def _mend(there: Path, scan: ScanInput, data: Scan, place: Place) -> None:
    """Make what is lost again, and have a session refer to its volume, wherever that is now.

    A person may have gone on with the session: what is in it stays.
    """
    from napari_unpack.io import open_session, save_session
    from napari_unpack.io.sessions import standing_of

    file, settings = there / SESSION, place.settings
    found = settings.copies or _finds_volume(file, scan, data, place.large)
    labelled = (there / LABELS[settings.labels]).exists()
    undrawn = [name for name in _drawings(settings) if not (there / name).exists()]
    if found and labelled and not undrawn:
        return
    session = open_session(file, data.volume, large=place.large)
    if not labelled:
        _write_labels(session, data, settings, there)
    if not found:
        save_session(session, file, False, scan.volume, standing=standing_of(file))
    if undrawn:
        # Last: what a person took out is drawn in the bag, with the way out of all the others.
        session.backend = "cpu"
        _plan(session)
        _draw(session, scan.name, undrawn, there)


def _finds_volume(session: Path, scan: ScanInput, data: Scan, large: bool) -> bool:
    """Tell whether a session holds its volume, or refers to a file that does."""
    try:
        file = volume_file_of(session)
        if file is None or file.samefile(scan.volume):
            return True
        # Two files may have taken each other's names.
        return np.array_equal(load_volume(file, large=large).volume, data.volume, equal_nan=True)
    except (OSError, ValueError):
        return False


def _plan(session: Session) -> None:
    """Find out in which order all come out; they go back, so that the session is packed."""
    stubborn = session.take_least_occluded
    # Interlocked objects may not stop it: every object has a place in the order.
    session.take_least_occluded = True
    for _ in unpack_in_order(session):
        pass
    session.go_to(0)
    session.take_least_occluded = stubborn


def _write(session: Session, scan: ScanInput, data: Scan, settings: Settings, folder: Path) -> None:
    from napari_unpack.io import save_session

    _draw(session, scan.name, _drawings(settings), folder)
    _write_labels(session, data, settings, folder)
    save_session(session, folder / SESSION, settings.copies, volume_path=scan.volume)


def _drawings(settings: Settings) -> list[str]:
    """Return the files that are drawn of each scan."""
    return [PAGE, PICTURE] * settings.pictures + [FILM] * settings.film


def _draw(session: Session, title: str, files: list[str], folder: Path) -> None:
    from napari_unpack.io import movie, save_objects_page, save_png
    from napari_unpack.rendering.compose import scene_image
    from napari_unpack.session.framing import fitted

    if PAGE in files:
        save_objects_page(session, folder / PAGE, title, backend="cpu", planned=True)
    if PICTURE in files:
        session.canvas_size = PICTURE_SIZE
        camera = fitted(session)
        session.look(camera)
        save_png(
            scene_image(session.scene(), camera, PICTURE_SIZE, backend="cpu"), folder / PICTURE
        )
    if FILM in files:
        movie(session, folder / FILM, backend="cpu")


def _write_labels(session: Session, data: Scan, settings: Settings, folder: Path) -> None:
    from napari_unpack.io.arrays import write_labels_npz
    from napari_unpack.io.ome_zarr import write_labels_zarr
    from napari_unpack.io.session_json import given_labels

    file, labels = folder / LABELS[settings.labels], given_labels(session)
    if settings.labels == "npz":
        write_labels_npz(file, labels, data.spacing)
        return
    with folder_written_atomically(file, lambda _: False) as temporary:
        write_labels_zarr(temporary, labels, data.spacing, data.scanner_from_scan)
