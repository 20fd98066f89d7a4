"""What commands share: arguments, files to open, decorations, and progress on stderr."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Annotated, Any

import typer

from napari_unpack.geometry.view import FROM_ABOVE, View

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from napari_unpack.appearance import Decorations
    from napari_unpack.io import Scan
    from napari_unpack.io.file_data import FileData
    from napari_unpack.io.scan import Spacing
    from napari_unpack.session import Session

_VOLUME = (
    "Volume: .npz, .npy, NIfTI, MetaImage, NRRD, TIFF or a folder of slices, DICOM folder or "
    "file, OME-Zarr"
)
VolumeInput = Annotated[Path, typer.Argument(metavar="INPUT", help=f"{_VOLUME}.")]
Input = Annotated[Path, typer.Argument(metavar="INPUT", help=f"{_VOLUME}; or a saved session.")]
LabelsOption = Annotated[
    Path | None,
    typer.Option(
        help="Label volume to use instead of labels in INPUT or beside it, or a segmentation."
    ),
]
At = Annotated[
    str | None,
    typer.Option(
        "--at",
        metavar="AXIS=N",
        help="Which channel or time point, where INPUT or its labels hold several: c=1, or "
        "t=0,c=1.",
    ),
]
LabelsAt = Annotated[
    str | None,
    typer.Option(
        "--at",
        metavar="AXIS=N",
        help="Which channel or time point, where TRUTH or FOUND holds several: t=1.",
    ),
]
SpacingOption = Annotated[
    str | None,
    typer.Option(
        "--spacing",
        metavar="'Z Y X'",
        help="Voxel size in mm instead of what INPUT says, such as '2 0.5 0.5', or one number for "
        "all three.",
    ),
]
Large = Annotated[
    bool,
    typer.Option(
        "--large",
        help="Open files even where they ask for more memory than is free, or for far more than "
        "they hold.",
    ),
]
Direction = Annotated[
    str | None,
    typer.Option(
        help="Where objects leave: up, +x, -x, +y, -y, +z, -z or 'z,y,x' numbers; "
        "by default towards the viewer."
    ),
]
_LOOKING = "Direction of looking; by default from above"
NewView = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--view", metavar="Z Y X", help=f"{_LOOKING}."),
]
ViewOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--view", metavar="Z Y X", help=f"{_LOOKING}, or a session's."),
]
Backend = Annotated[str, typer.Option(help="What renders: auto, cpu or gl.")]


def _tell_version(asked: bool) -> None:
    if asked:
        from napari_unpack import __version__

        typer.echo(f"napari-unpack {__version__}")
        raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version", callback=_tell_version, is_eager=True, help="Print the version and stop."
    ),
]


def expanded(value: Any) -> Any:
    """Return what a command was given, with the person's own folder for ``~`` in all paths."""
    # Imported late, as all that commands do not need for `--help`.
    from napari_unpack.atomic import given_path

    # Once, and for all commands alike: a file is then checked, read and written by one name.
    if isinstance(value, list):
        return [expanded(one) for one in value]
    return given_path(value) if isinstance(value, Path) else value


class Ticker:
    """Progress as plain lines on stderr: one a step, and one every 5 % of it.

    What a text says after a colon is a count within a step and makes no new line.
    """

    def __init__(self) -> None:
        self._last = ("", -1)

    def __call__(self, fraction: float, text: str) -> None:
        """Report how far the work is."""
        # A line every 5 %: a log file shall stay readable.
        now = (text.split(":")[0], int(fraction * 20))
        if now != self._last:
            self._last = now
            # On stderr, so that tables and orders can be piped.
            typer.echo(f"{fraction:4.0%}  {text}", err=True)


def load_input(source: Path, at: str | None, large: bool, spacing: str | None) -> Scan:
    """Return the volume of a file; say on stderr what had to be assumed of it.

    Parameters
    ----------
    source : Path
    at : str, optional
        As the option takes it.
    large : bool
        As for `load_volume`.
    spacing : str, optional
        As the option takes it.

    Raises
    ------
    ValueError
        If `at` or `spacing` is not as the option wants it; else as for `load_volume`.
    """
    given = given_spacing(spacing)
    scan = _stored_input(source, at, large, given)
    return scan if given is None else scan.with_spacing(given)


def _stored_input(source: Path, at: str | None, large: bool, given: Spacing | None) -> Scan:
    """Return the volume of a file with the voxel size that the file gives it."""
    from napari_unpack.geometry.length_unit import SIZE_ASSUMED, assumed_besides_size
    from napari_unpack.io import load_volume

    scan = load_volume(source, chosen_elements(at), large)
    if given is not None:
        # It need not be assumed, nor said of the labels.
        scan = replace(scan, assumed=assumed_besides_size(scan.assumed))
    advice = "; --spacing 'Z Y X' gives it in mm"
    _tell_assumed(source, (s + advice if SIZE_ASSUMED.search(s) else s for s in scan.assumed))
    return scan


def given_spacing(spacing: str | None) -> Spacing | None:
    """Return the voxel size that is given; None where none is.

    Parameters
    ----------
    spacing : str, optional
        As the option takes it.
    """
    from napari_unpack.io.scan import spacing_from

    return None if spacing is None else spacing_from(spacing, "--spacing")


def chosen_elements(at: str | None) -> dict[str, int]:
    """Return which channel or time point is meant, by the letter of its axis.

    Parameters
    ----------
    at : str, optional
        As the option takes it.

    Raises
    ------
    ValueError
        If it is not as the option wants it.
    """
    chosen = {}
    for part in at.split(",") if at else ():
        axis, _, number = part.partition("=")
        # Not isdigit, which takes ² as well.
        if not number.strip().isdecimal():
            raise ValueError(f"--at must be like c=1 or t=0,c=1, got {at!r}")
        chosen[axis.strip()] = int(number)
    return chosen


def _tell_assumed(source: Path, assumed: Iterable[str]) -> None:
    for sentence in assumed:
        typer.echo(f"note: {source.name}: {sentence}", err=True)


def load_compared(
    truth: Path, found: Path, at: str | None, large: bool
) -> tuple[FileData, NDArray[Any]]:
    """Return true labels with all that their file says, and those that were found, laid over them.

    Parameters
    ----------
    truth, found : Path
        Files of labels.
    at : str, optional
        As the option takes it; goes for whichever has that axis.
    large : bool
        As for `load_volume`.

    Raises
    ------
    ValueError
        If `at` is not as the option wants it, or neither file has such an axis; else as for
        `load_labels`.
    """
    from napari_unpack.io.labels_on_volume import laid_over
    from napari_unpack.io.volumes import load_label_file

    chosen = chosen_elements(at)
    for file in (truth, found):
        tell_labels_beside(file)
    # Voxels of the truth count: found labels often come without a voxel size.
    true, other = (load_label_file(file, large, chosen) for file in (truth, found))
    unknown = sorted(set(chosen) - {*true.axes, *other.axes})
    if unknown:
        raise ValueError(f"neither {truth} nor {found} has an axis {', '.join(unknown)}: see --at")
    seen, said = laid_over(other, replace(true, volume=true.labels))
    if said:
        typer.echo(f"note: {found.name}: its labels {said}", err=True)
    return true, seen


def tell_labels_beside(file: Path) -> None:
    """Say on stderr where a file that is taken for labels may be the volume they are of."""
    from napari_unpack.io.volumes import saved_files

    # A name of one's own may be too long for that beside it.
    for labels in saved_files(file)[1:] if file.name else ():
        if os.path.exists(labels):
            typer.echo(
                f"note: {file} is taken for labels, and {labels.name} lies beside it: is that "
                "the file you mean?",
                err=True,
            )


@dataclass(frozen=True)
class LabelledScans:
    """Volumes with labels to learn from, read one after another: there may be hundreds.

    Parameters
    ----------
    paths : list of Path
        Reading one raises `ValueError` where neither it nor a file beside it has labels.
    large : bool
        As for `load_volume`.
    """

    paths: list[Path]
    large: bool

    def __len__(self) -> int:
        return len(self.paths)

    def __iter__(self) -> Iterator[Scan]:
        for path in self.paths:
            yield _labelled_scan(path, self.large)


def _labelled_scan(path: Path, large: bool) -> Scan:
    from napari_unpack.io import load_volume

    scan = _with_labels_beside(load_volume(path, large=large), path, large, {})
    if scan.labels is None or not scan.labels.any():
        raise ValueError(f"{path} needs labels to learn from: segment it first")
    return scan


def _with_labels_beside(
    scan: Scan, source: Path, large: bool, at: dict[str, int], more: str = "", instead: str = ""
) -> Scan:
    """Return a scan without labels with those that lie beside its file, as `segment` writes them.

    What is done is said on stderr, with what can be done about it.
    """
    from napari_unpack.io.labels_on_volume import scan_with_label_file
    from napari_unpack.io.volumes import saved_files, suffix_of

    # Slices and folders of them have no suffix that tells them from any other name.
    beside = saved_files(source)[1:] if suffix_of(source) else []
    if scan.labels is not None or not beside or not os.path.exists(beside[0]):
        return scan
    (file,) = beside
    try:
        # A copy of both may have been made in either order.
        older = file.stat().st_mtime < source.stat().st_mtime
        found = scan_with_label_file(scan, file, large, at)
    except (ValueError, OSError, ImportError, MemoryError) as error:
        _tell_assumed(source, (f"{file.name} beside it is left out: {error}{instead}",))
        return scan
    aged = ", which are older than it" if older else ""
    told = f"its labels are those beside it, {file.name}{aged}{more}"
    _tell_assumed(source, (told, *found.assumed[len(scan.assumed) :]))
    return found


def open_input(
    source: Path,
    labels: Path | None,
    direction: str | None,
    view: tuple[float, float, float] | None,
    backend: str,
    at: str | None = None,
    large: bool = False,
    spacing: str | None = None,
) -> Session:
    """Return the session of a file: a saved one, or a new one on a volume.

    Parameters
    ----------
    source, labels : Path
        What the command was given.
    direction : str, optional
        Where objects leave, see `direction_of`.
    view : (float, float, float), optional
        Direction of looking, z y x; from above where neither it nor a saved session says.
    backend : {"auto", "cpu", "gl"}
    at : str, optional
        Which channel or time point, see `load_input`.
    large : bool
        As for `load_volume`.
    spacing : str, optional
        Voxel size, see `load_input`.

    Raises
    ------
    ValueError
        If labels, a channel or time point, or a voxel size are given beside a saved session.
    """
    # Imported late: these load numba, which takes longer than `--help` should.
    from napari_unpack.io import open_session
    from napari_unpack.io.headless import open_scan
    from napari_unpack.io.label_names import is_segmentation, segment_names
    from napari_unpack.io.labels_on_volume import scan_with_label_file
    from napari_unpack.io.session_archive import holds_session

    if holds_session(source):
        if labels is not None:
            raise ValueError("a session has labels of its own: leave --labels out")
        if at is not None:
            raise ValueError("a session is of one channel and time point: leave --at out")
        if spacing is not None:
            raise ValueError("a session has a voxel size of its own: leave --spacing out")
        session = open_session(source, progress=Ticker(), large=large)
        _tell_assumed(source, session.assumed)
        # A session saved while an object was inspected: commands work on the bag.
        session.leave()
        session.backend = backend
        if view is not None:
            session.view = View(view)
        if direction is not None:
            session.direction = direction_of(direction)
        return session
    # By what the files say labels lie on their volume: they may have one wrong size.
    given = given_spacing(spacing)
    scan = _stored_input(source, at, large, given)
    if labels is not None:
        tell_labels_beside(labels)
        known = len(scan.assumed)
        scan = scan_with_label_file(scan, labels, large, chosen_elements(at))
        _tell_assumed(source, scan.assumed[known:])
        if is_segmentation(labels):
            scan = replace(scan, names=segment_names(labels))
    else:
        anew = "; it is segmented anew, unless --labels names labels"
        more = "; --labels takes others"
        scan = _with_labels_beside(scan, source, large, chosen_elements(at), more, anew)
    if given is not None:
        scan = scan.with_spacing(given)
    return open_scan(scan, view or FROM_ABOVE, direction_of(direction), Ticker(), backend)


def check_output(
    path: Path, suffixes: tuple[str, ...], *inputs: Path | None, folder: bool = False
) -> None:
    """Refuse what cannot be written before the long work, not after it.

    Parameters
    ----------
    path : Path
        The output.
    suffixes : tuple of str
        What its name may end in, lower case.
    *inputs : Path, optional
        What the command reads.
    folder : bool
        Whether the output may be a folder.

    Raises
    ------
    ValueError
        If it ends in none of them or is nothing else, is one of the inputs or holds one, or is a
        folder.
    FileNotFoundError
        If its folder does not exist.
    PermissionError
        If nothing can be written there.
    """
    from napari_unpack.atomic import check_writable

    name = path.name.lower()
    if not name.endswith(suffixes):
        raise ValueError(f"{path}: the output must end in {' or '.join(suffixes)}")
    if name and name in suffixes:
        raise ValueError(f"{path} is a suffix alone: give the output a name, such as bag{name}")
    there = [given for given in inputs if given and given.exists()]
    # By what it is and not by its name: links and upper case lead to one file as well.
    if any(os.path.exists(path) and path.samefile(given) for given in there):
        raise ValueError(f"{path} is the input and would be overwritten: choose another output")
    if any(given.resolve().is_relative_to(path.resolve()) for given in there):
        raise ValueError(f"{path} holds the input, which would be lost: choose another output")
    # Not Path's own, which raises what the system says of a name that is too long.
    if os.path.isdir(path) and not folder:
        raise ValueError(f"{path} is a folder: choose another output")
    check_writable(path)


def check_segmentation(source: Path, output: Path, csv: Path | None) -> None:
    """Refuse outputs of `segment` that cannot be written, or whose place is another's.

    Parameters
    ----------
    source : Path
        What is segmented.
    output : Path
        Where volume and labels go.
    csv : Path, optional
        Where the table goes.

    Raises
    ------
    ValueError
        If a file of labels is there that nobody named, the table is to be written over the
        labels or is no .csv, and as for `check_output`.
    FileNotFoundError, PermissionError
        As for `check_output`.
    """
    from napari_unpack.io.volumes import WRITABLE, saved_files

    zarr = output.suffix.lower() == ".zarr"
    check_output(output, (*WRITABLE, ".zarr"), source, folder=zarr)
    outputs = [output] if zarr else saved_files(output)
    for labels in outputs[1:]:
        check_output(labels, WRITABLE, source)
        # Even where they were written by the same command: they may have been corrected since.
        if os.path.exists(labels):
            raise ValueError(
                f"{labels} is there and would be overwritten by the labels that are found: "
                "choose another output, or move or remove that file first"
            )
    if csv is not None:
        if csv.resolve() in [file.resolve() for file in outputs]:
            raise ValueError(f"{csv} holds the labels: choose another file for the table")
        check_output(csv, (".csv",), source)


def table_beside(output: Path) -> Path:
    """Return where the table of a simulated bag goes.

    Parameters
    ----------
    output : Path
        Of the bag.

    Raises
    ------
    ValueError
        If a file of another's is there, or it cannot be written, see `check_output`.
    """
    from napari_unpack.io.volumes import stem_of

    table = output.with_name(stem_of(output) + ".csv")
    check_output(table, (".csv",))
    # Beside a bag it is that bag's.
    if os.path.exists(table) and not os.path.exists(output):
        raise ValueError(
            f"{table} is there and would be overwritten by the table of the bag: choose another "
            "output"
        )
    return table


def write_somewhere(save: Callable[[Path], Iterable[Path]], path: Path, suffix: str) -> None:
    """Save what took long to find; where that fails, in the folder for temporary files.

    Parameters
    ----------
    save : callable
        Returns the files it has written, which are told.
    path : Path
        Where they should be.
    suffix : str
        Of the file in the other folder.

    Raises
    ------
    OSError
        Once all is told, why it is not where it should be; or if it can be saved in neither place.
    """
    failed = None
    try:
        files = save(path)
    except OSError as error:
        failed = error
        files = save(Path(mkdtemp(prefix="napari-unpack-")) / f"{path.name.split('.')[0]}{suffix}")
    for file in files:
        typer.echo(f"wrote {file}")
    if failed is not None:
        raise failed


def direction_of(text: str | None) -> str | tuple[float, float, float] | None:
    """Return a direction as `Session.direction` takes it.

    Raises
    ------
    ValueError
        If it is neither a name nor three numbers.
    """
    # Names are checked by the session, which knows them all.
    if text is None or "," not in text:
        return text
    try:
        z, y, x = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"direction must be a name or three numbers 'z,y,x', got {text!r}"
        ) from error
    return z, y, x


Ground = Annotated[
    str | None,
    typer.Option(
        "--background",
        help="dark, dusk, light, daylight, black, white, '#rrggbb', two of these with a comma "
        "between (top, bottom), or a picture's path.",
    ),
]
Box = Annotated[bool, typer.Option("--box", help="Draw the box around all objects.")]
Scale = Annotated[bool, typer.Option("--scale-bar", help="Draw a scale bar.")]


def picture_file(background: str | None) -> Path | None:
    """Return the picture that a background is, an input of the command; None where it is colours.

    Parameters
    ----------
    background : str, optional
        As the option takes it.
    """
    from napari_unpack.appearance.background import is_picture
    from napari_unpack.atomic import given_path

    return given_path(background) if background is not None and is_picture(background) else None


def requested_decorations(background: str | None, box: bool, scale: bool) -> Decorations | None:
    """Return what is drawn around the bag; None where nothing was asked for.

    Parameters
    ----------
    background : str, optional
        As the option takes it; dark where only decorations are asked for.
    box, scale : bool
        Whether they are drawn.
    """
    # A saved session has decorations of its own, which None leaves as they are.
    from napari_unpack.appearance import Decorations

    shown = [kind for kind, wanted in (("box", box), ("scale", scale)) if wanted]
    if background is None and not shown:
        return None
    return Decorations.of(background or "dark", shown)
