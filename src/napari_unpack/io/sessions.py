"""Session files: everything needed to go on where one stopped."""

from __future__ import annotations

import io
import json
import os
from base64 import b64decode, b64encode
from functools import partial
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO, TYPE_CHECKING, Any
from zlib import compress, decompressobj

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.atomic import given_path
from napari_unpack.file_sizes import check_size, stored_size
from napari_unpack.io.json_fields import Fields
from napari_unpack.io.model_json import SavedModel, model_record, saved_model
from napari_unpack.io.session_archive import (
    MANIFEST,
    QUICK,
    ArrayFacts,
    Source,
    opened_for_reading,
    opened_for_writing,
    read_array,
    write_array,
)
from napari_unpack.read_errors import read_errors_told
from napari_unpack.tasks import Progress, Share, attended, no_progress
from napari_unpack.version import __version__

if TYPE_CHECKING:
    from napari_unpack.geometry.view import Camera
    from napari_unpack.rendering.scene import Scene
    from napari_unpack.session import Session

# A version changes when older programs could not read it; fields that may be missing do not.
FORMAT = "napari-unpack session"
VERSION = 1
# 256 MB: far above any table of objects, far below what would exhaust the memory.
LARGEST_MANIFEST = 1 << 28
# Bytes that a byte of JSON becomes at most: `[],` is a list of 56 and a pointer of 8.
PARSED = 22
PICTURE = (240, 320)
# Sprites of the picture that are drawn without stairs, which takes three times as long.
MOST_SMOOTH = 50


def save_session(
    session: Session,
    path: str | Path,
    copy: bool = True,
    volume_path: str | Path | None = None,
    labels_path: str | Path | None = None,
    progress: Progress | None = None,
    standing: ArrayLike | None = None,
) -> Path:
    """Save a session: a file or folder from which `open_session` goes on.

    Parameters
    ----------
    session : Session
        What is in the air is saved as landed. The steps of undo are not saved.
    path : str or Path
        One file where it ends in .unpack or .zip, else a folder. What is there already is
        replaced once the new one is whole, and only then.
    copy : bool
        Put the volume and the labels in. False refers to `volume_path`, and to `labels_path`
        where that is given, instead: small, but the files must stay.
    volume_path, labels_path : str or Path, optional
        Files that `load_volume` and `load_labels` read these arrays from.
    progress : callable, optional
        Takes (fraction, text); raising in it cancels and leaves what was there.
    standing : (4, 4) array_like, optional
        How the session's world stands in that of a viewer, mm, for `standing_of`.

    Raises
    ------
    ValueError
        If `copy` is False without a `volume_path`, a file does not hold these arrays, something of
        the session is beyond what `open_session` takes, or the name is a volume's (bag.npz).
    OSError
        If it cannot be written, such as on a full disk; what was there stays.

    Notes
    -----
    JSON, PNG and .npz alone, nothing that is run on opening. Arrays are written with shape,
    dtype and SHA-256, which are checked on opening.
    """
    from napari_unpack.io.session_json import given_labels

    target = given_path(path)
    report = progress or no_progress
    if not copy and volume_path is None:
        raise ValueError("copy=False needs volume_path, the file the volume came from")
    report(0.0, "Saving")
    manifest = manifest_of(session, standing)
    # What would not open again is not to replace what does.
    _check(json.loads(written(manifest)), session)
    arrays = {"volume": np.asarray(session.volume), "labels": given_labels(session)}
    # All that is written is of one moment: writing takes long, and a session may go on meanwhile.
    scene, camera = session.scene(), session.camera
    files = {"volume": volume_path, "labels": labels_path}
    # Shares of the progress: the volume compresses worst and takes longest.
    ends = {"volume": (0.0, 0.6), "labels": (0.6, 0.9)}
    with opened_for_writing(target) as member:
        for name, array in arrays.items():
            file = files[name]
            told = Share(report, *ends[name], f"Saving the {name}")
            if copy or file is None:
                with member(f"{name}.npz") as stream:
                    facts = write_array(stream, array, told)
                where = {"file": f"{name}.npz"}
            else:
                # Measured even where it is not copied in, so that a changed file is noticed.
                facts = attended(partial(ArrayFacts.of, array), told.part(0.0, 0.3))
                named = partial(_reference, Path(file), target, name, facts)
                where = {"reference": attended(named, told.part(0.3, 1.0))}
            manifest[name] = where | facts.record()
        state = Share(report, 0.9, 1.0, "Saving the state")
        state()
        # Small and before the manifest, which makes a folder a session: it comes last.
        with member("picture.png") as stream:
            stream.write(attended(partial(_picture, scene, camera), state))
        with member(MANIFEST) as stream:
            stream.write(written(manifest))
    report(1.0, "Saved")
    return target


def manifest_of(session: Session, standing: ArrayLike | None) -> dict[str, Any]:
    """Return all that a session's file says beside its arrays, as plain data.

    Parameters
    ----------
    session, standing
        As for `save_session`.
    """
    from napari_unpack.io.answers import evidence_record
    from napari_unpack.io.session_json import record_of

    evidence = session.review.evidence
    return {
        "format": FORMAT,
        "version": VERSION,
        "written_by": f"napari-unpack {__version__}",
        "session": record_of(session),
        "standing": None if standing is None else np.asarray(standing, np.float64).tolist(),
        "first_voxel_mm": session.first_voxel_mm.tolist(),
        "containers": _containers_record(session),
        **model_record(session),
        **({} if evidence is None else {"evidence": evidence_record(evidence)}),
    }


def _check(manifest: dict[str, Any], session: Session) -> None:
    from napari_unpack.io.session_json import check_record

    check_record(manifest["session"], session)
    saved_model(Fields(manifest, MANIFEST))
    inside = session.opened_bags.worked_in(session)
    for told in manifest["containers"]:
        _check(told, inside[told["object"]])


def _containers_record(session: Session) -> list[dict[str, Any]]:
    """Return what was unpacked inside objects; their volumes are parts of the session's."""
    from napari_unpack.io.session_json import given_labels, record_of

    return [
        {
            "object": object_id,
            "session": record_of(bag),
            **model_record(bag, session),
            # As text: most are small, and those of large objects are long runs.
            "labels": b64encode(
                compress(given_labels(bag).astype("<u2").tobytes(), QUICK)
            ).decode(),
            "containers": _containers_record(bag),
        }
        for object_id, bag in session.opened_bags.worked_in(session).items()
    ]


def _restore_inside(session: Session, fields: Fields, model: SavedModel) -> None:
    """Give a session the model of its file, and the bags that its objects were opened as."""
    from napari_unpack.io.session_json import session_from
    from napari_unpack.session.containers import begins_at, volume_inside

    model.give_to(session)
    # Older files do not tell of them.
    for told in fields.parts("containers") if fields.has("containers") else ():
        object_id = told.integer("object", 1)
        if object_id not in session.ids:
            raise ValueError(f"containers must be of objects of the session, got {object_id}")
        volume = volume_inside(session, object_id)
        # No more than there are voxels: a forged text may unpack to any length.
        flat = decompressobj().decompress(b64decode(told.text("labels")), 2 * volume.size)
        if len(flat) != 2 * volume.size:
            raise ValueError(f"the labels inside object {object_id} are not whole")
        labels = np.frombuffer(flat, "<u2").reshape(volume.shape).astype(np.uint16)
        bag = session_from(told["session"], volume, labels)
        bag.first_voxel_mm = session.first_voxel_mm + begins_at(session, object_id)
        _restore_inside(bag, told, saved_model(told, model))
        session.opened_bags.restore(session, object_id, bag)


def written(manifest: dict[str, Any]) -> bytes:
    """Return a manifest as it is written."""
    return json.dumps(manifest, allow_nan=False, indent=1).encode()


def open_session(
    path: str | Path,
    volume: NDArray[Any] | None = None,
    labels: NDArray[Any] | None = None,
    progress: Progress | None = None,
    large: bool = False,
) -> Session:
    """Open a session in exactly the state it was saved in, with nothing to undo.

    Parameters
    ----------
    path : str or Path
        From `save_session`.
    volume, labels : (Z, Y, X) ndarray, optional
        The arrays themselves, for a session that refers to files which are gone.
    progress : callable, optional
        Takes (fraction, text); raising `Cancelled` in it cancels.
    large : bool
        As for `load_volume`.

    Raises
    ------
    FileNotFoundError
        If it, or a file it refers to, is not there.
    ValueError
        If it is damaged, no session, of a newer version, or refers to other data than it was
        saved with; the message says what.
    """
    from napari_unpack.io.answers import evidence_from
    from napari_unpack.io.session_json import session_from

    source = given_path(path)
    report = progress or no_progress
    report(0.0, "Opening the session")
    with read_errors_told(source, "a session"):
        with opened_for_reading(source) as store:
            fields = _manifest(store, source, large)
            given = {"volume": volume, "labels": labels}
            ends = {"volume": (0.0, 0.6), "labels": (0.6, 0.8)}
            found = {
                name: _array(
                    store,
                    fields.part(name),
                    source,
                    name,
                    given[name],
                    large,
                    Share(report, *ends[name], f"Reading the {name}"),
                )
                for name in ("volume", "labels")
            }
        report(0.8, "Making the session ready")
        made = partial(session_from, fields["session"], found["volume"], found["labels"])
        session = attended(made, Share(report, 0.8, 1.0, "Making the session ready"))
        # Older files do not tell.
        if fields.has("first_voxel_mm"):
            session.first_voxel_mm = fields.array("first_voxel_mm", (3,))
        _restore_inside(session, fields, saved_model(fields))
        if fields.has("evidence"):
            shape = session.labels.shape
            session.review.evidence = evidence_from(fields.part("evidence"), shape)
    report(1.0, "Opened")
    return session


def standing_of(path: str | Path) -> NDArray[np.float64] | None:
    """Return how the bag of a saved session stood in its viewer, (4, 4); None where it is not told.

    The affine from mm along the scan's axes to mm of the viewer's world.

    Raises
    ------
    ValueError
        If it is damaged, or no affine that can be inverted.
    """
    source = given_path(path)
    with read_errors_told(source, "a session"), opened_for_reading(source) as store:
        fields = _manifest(store, source, large=True)
    if not fields.has("standing"):
        return None
    found = fields.array("standing", (4, 4))
    volume = abs(float(np.linalg.det(found[:3, :3])))
    if not 0 < volume < np.inf or found[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(
            f"{source} must tell how its bag stands by an affine that can be inverted, got "
            f"{found.tolist()}"
        )
    return found


def volume_file_of(path: str | Path) -> Path | None:
    """Return the file that a saved session refers to for its volume; None where it holds a copy.

    Raises
    ------
    FileNotFoundError
        If the session, or the file, is not there.
    ValueError
        If the session is damaged, or refers to a file that it may not refer to.
    """
    source = given_path(path)
    with read_errors_told(source, "a session"), opened_for_reading(source) as store:
        told = _manifest(store, source, large=True).part("volume")
        if not told.has("reference"):
            return None
        return _referred_file(told.text("reference"), source, "volume")


def _manifest(store: Source, source: Path, large: bool) -> Fields:
    if MANIFEST not in store.names:
        raise ValueError(f"{source} is no session: it lacks {MANIFEST}")
    with store.open(MANIFEST) as stream:
        # One more than allowed tells that it is too large, without reading it all.
        text = stream.read(LARGEST_MANIFEST + 1)
    if len(text) > LARGEST_MANIFEST:
        raise ValueError(f"{source} is no session: its {MANIFEST} is too large")
    check_size(f"{MANIFEST} of {source}", PARSED * len(text), stored_size(source), large=large)
    try:
        data = json.loads(text.decode(), parse_constant=_no_constant)
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"{source} is damaged: {MANIFEST} is not readable: {error}") from error
    fields = Fields(data, MANIFEST)
    if not fields.has("format") or fields["format"] != FORMAT:
        raise ValueError(f"{source} is no session of napari-unpack")
    version = fields.integer("version", 1)
    if version > VERSION:
        raise ValueError(
            f"{source} was saved by a newer napari-unpack (form {version}; this one reads up to "
            f"{VERSION}): update napari-unpack to open it"
        )
    return fields


def _no_constant(name: str) -> Any:
    raise ValueError(f"{MANIFEST} must hold finite numbers, got {name}")


def _array(
    store: Source,
    fields: Fields,
    source: Path,
    name: str,
    given: NDArray[Any] | None,
    large: bool,
    share: Share,
) -> NDArray[Any]:
    shape = tuple(int(n) for n in fields.array("shape", (3,)))
    facts = ArrayFacts(shape, fields.text("dtype"), fields.text("sha256"))
    if given is not None:
        # Byte order and width may differ from those saved; the content is checked below.
        array = np.asarray(given).astype(facts.dtype, copy=False)
        facts.check(array, f"the {name} given")
        return array
    if fields.has("file"):
        member = fields.text("file")
        # A fixed name: a session may not point to a file of its choice.
        if member != f"{name}.npz":
            raise ValueError(f"{source} must keep its {name} as '{name}.npz', got {member!r}")
        if member not in store.names:
            raise ValueError(f"{source} is not whole: it lacks {member}")
        stored = None if large else stored_size(source)
        with store.open(member) as stream:
            return read_array(_seekable(stream), facts, f"{member} of {source}", share, stored)
    referred = partial(_referred, fields.text("reference"), source, name, facts, large)
    return attended(referred, share)


def _seekable(stream: IO[bytes]) -> IO[bytes]:
    return stream if stream.seekable() else io.BytesIO(stream.read())


def _referred(
    reference: str, source: Path, name: str, facts: ArrayFacts, large: bool
) -> NDArray[Any]:
    """Read an array from the file a session refers to."""
    file = _referred_file(reference, source, name)
    array = _loaded(file, name, large)
    facts.check(array.astype(facts.dtype, copy=False), f"the {name} in {file}")
    return array.astype(facts.dtype, copy=False)


def _referred_file(reference: str, source: Path, name: str) -> Path:
    # Both kinds of separators, wherever the session was made.
    windows, posix = PureWindowsPath(reference), PurePosixPath(reference)
    # Windows logs in to whatever computer is named, so that to ask whether a file is there tells it
    # who the user is, and a hash of the password.
    remote = reference.replace("/", "\\").startswith("\\\\")
    if remote and windows.drive not in {PureWindowsPath(source.absolute()).drive} - {""}:
        raise ValueError(
            f"{source} refers to its {name} on another computer, {reference!r}: open that file "
            f"yourself in Python and pass {name}= to open_session"
        )
    if ".." in (*posix.parts, *windows.parts) or not reference:
        raise ValueError(
            f"{source} refers to its {name} by a path that leaves its folder: {reference!r}"
        )
    file = Path(reference)
    if not file.is_absolute():
        file = source.parent / file
    if not file.exists():
        raise FileNotFoundError(
            f"{source} refers to its {name} in {file}, which is not there: put it back there, or "
            f"in Python pass {name}= to open_session"
        )
    return file


def _reference(file: Path, target: Path, name: str, facts: ArrayFacts) -> str:
    """Return how a session refers to a file, which must hold the array."""
    # Read back at once: a reference to another volume would be found only on opening.
    file = given_path(file)
    if file.resolve().is_relative_to(target.resolve()):
        raise ValueError(
            f"the {name} is in {file}, which saving to {target} would replace: choose another "
            "name for the session, or copy=True to put the arrays in"
        )
    array = _loaded(file, name, large=True)
    facts.check(array.astype(facts.dtype, copy=False), f"the {name} in {file}")
    home, real = target.absolute().parent.resolve(), file.resolve()
    # Relative where it can be, so that a folder can be moved with its session. Elsewhere not
    # resolved: that would make a computer's name of a drive's letter, which is refused on opening.
    if real.is_relative_to(home):
        return real.relative_to(home).as_posix()
    return os.path.abspath(file)


def _loaded(file: Path, name: str, large: bool) -> NDArray[Any]:
    from napari_unpack.io.volumes import load_labels, load_volume

    if name == "volume":
        return load_volume(file, large=large).volume
    return load_labels(file, large)[0]


def _picture(scene: Scene, camera: Camera) -> bytes:
    """Return a small picture of the bag as PNG, for people who look into the file."""
    from napari_unpack.io.images import png_bytes, straight_bytes
    from napari_unpack.rendering.compose import scene_image

    # On the processor: saving may run on a thread without a GL context.
    smooth = len(scene.poses) <= MOST_SMOOTH
    image = scene_image(scene, camera, PICTURE, backend="cpu", smooth=smooth)
    return png_bytes(straight_bytes(image))
