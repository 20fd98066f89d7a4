"""The command `napari-unpack`: everything the plugin does, without a window."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer

# Only typer and names here: commands import what they need, so that `--help` comes at once.
from napari_unpack.cli_options import (
    At,
    Backend,
    Box,
    Direction,
    Ground,
    Input,
    LabelledScans,
    LabelsAt,
    LabelsOption,
    Large,
    NewView,
    Scale,
    SpacingOption,
    Ticker,
    Version,
    ViewOption,
    VolumeInput,
    check_output,
    check_segmentation,
    direction_of,
    expanded,
    given_spacing,
    load_compared,
    load_input,
    open_input,
    picture_file,
    requested_decorations,
    table_beside,
    write_somewhere,
)

app = typer.Typer(
    name="napari-unpack",
    help="See into packed things: segment a CT volume, tell every object apart, and unpack it.",
    no_args_is_help=True,
    # Completion would write into the user's shell files.
    add_completion=False,
    rich_markup_mode="rich",
    # A traceback is for a bug report: plain, without local variables and with no colours.
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def main() -> None:
    """Run the command line."""
    # Readers warn of each odd tag of a file; what matters of it is told in a sentence.
    warnings.filterwarnings("ignore", module="pydicom|tifffile|zarr")
    # Names have letters that a terminal or a pipe may not have: the rest is printed all the same.
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")
    app()


@app.callback()
def _napari_unpack(version: Version = False) -> None:
    pass


def _command(**settings: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command of a function, by its name without the underscore."""

    def register(command: Callable[..., None]) -> Callable[..., None]:
        # A sentence instead of a traceback for everything a user can cause.
        @functools.wraps(command)
        def run(**given: Any) -> None:
            try:
                command(**{name: expanded(value) for name, value in given.items()})
            except BrokenPipeError:
                # As of `| head`: click ends without a word.
                raise
            # Overflow: Python has numbers of any size, libraries have not.
            except (
                ValueError,
                TypeError,
                OSError,
                ImportError,
                MemoryError,
                OverflowError,
            ) as error:
                typer.echo(f"error: {_advice_about_options(str(error))}", err=True)
                raise typer.Exit(1) from error

        return app.command(command.__name__.removeprefix("_"), **settings)(run)

    return register


def _advice_about_options(sentence: str) -> str:
    """Replace advice about keyword arguments where nothing was found."""
    reason, _, advice = sentence.partition("; pass ")
    return f"{reason}; `segment` takes a smaller --smallest" if "smallest=" in advice else sentence


@_command()
def _simulate(
    output: Annotated[
        Path,
        typer.Argument(metavar="OUTPUT", help="Where to save the bag: .npz, .mha, .nii.gz ..."),
    ],
    seed: Annotated[int, typer.Option(help="Another seed, another bag.")] = 0,
    shape: Annotated[tuple[int, int, int], typer.Option(metavar="Z Y X", help="Voxels.")] = (
        160,
        176,
        256,
    ),
    count: Annotated[int, typer.Option(help="How many objects.")] = 30,
    spacing: Annotated[
        str,
        typer.Option(
            metavar="'Z Y X'",
            help="Voxel size in mm, such as '2 0.5 0.5', or one number for all three.",
        ),
    ] = "1",
    fidelity: Annotated[
        str,
        typer.Option(help="image: quick; projection: photons counted along rays, with streaks."),
    ] = "image",
) -> None:
    """Simulate a packed bag with its true labels, and a table of its objects beside it."""
    from napari_unpack import simulate_bag
    from napari_unpack.io import Scan, save_objects_csv, save_scan
    from napari_unpack.io.scan import spacing_from
    from napari_unpack.io.volumes import WRITABLE

    # Before the long work: a wrong name is told at once.
    check_output(output, WRITABLE)
    table, mm = table_beside(output), spacing_from(spacing, "--spacing")
    bag = simulate_bag(
        seed=seed, shape=shape, count=count, spacing=mm, progress=Ticker(), fidelity=fidelity
    )
    # Names go into the file, so that the viewer and `table` show what things are.
    names = {int(i): str(name) for i, name in bag.objects["name"].items()}
    saved = save_scan(Scan(bag.volume, bag.spacing, bag.labels, "bag", names), output)
    for path in (*saved, save_objects_csv(bag.objects, table)):
        typer.echo(f"wrote {path}")


@_command()
def _segment(
    source: VolumeInput,
    output: Annotated[
        Path, typer.Argument(metavar="OUTPUT", help="Where to save volume and labels.")
    ],
    csv: Annotated[Path | None, typer.Option(help="Where to save the table of objects.")] = None,
    smallest: Annotated[
        float | None,
        typer.Option(help="Smaller things are no objects, mm^3; by default 500 mm^3 or voxels."),
    ] = None,
    grainy: Annotated[
        bool | None,
        typer.Option(
            "--grainy/--plain",
            help="Take noise and haze away first, as of nuclei under a microscope, or do not; "
            "by default that is found out.",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of Zarr to Zarr: Dask cluster that does the blocks."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Of Zarr to Zarr: processes on this machine.")
    ] = None,
    working: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="MILLIONS",
            help="Of Zarr to Zarr: voxels that a larger volume is reduced to, in which objects are "
            "found; by default 16, and up to 128 where many small things are in it.",
        ),
    ] = None,
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Segment a volume into its objects; from Zarr to Zarr block by block, whatever its size."""
    from napari_unpack import segment
    from napari_unpack.io import save_objects_csv, save_scan
    from napari_unpack.io.volumes import check_savable, lost_place

    zarr = output.suffix.lower() == ".zarr"
    check_segmentation(source, output, csv)
    if zarr:
        from napari_unpack.batches.large_files import segment_zarr

        if at is not None:
            raise ValueError("--at is not for Zarr outputs: give the volume itself")
        if large:
            raise ValueError("--large is not for Zarr outputs: they are made block by block")
        if source.is_file():
            raise ValueError(f"a .zarr output needs a Zarr input, and {source} is none")
        objects = segment_zarr(
            source,
            output,
            smallest,
            grainy,
            scheduler,
            workers,
            None if working is None else working * 10**6,
            Ticker(),
            lambda sentence: typer.echo(sentence, err=True),
            given_spacing(spacing),
        )
        # Saved before anything is said: whoever reads it may have gone.
        if csv is not None:
            write_somewhere(lambda path: [save_objects_csv(objects, path)], csv, ".csv")
        typer.echo(f"wrote {output}")
        typer.echo(f"{len(objects)} objects")
        return
    for option, value in (("scheduler", scheduler), ("workers", workers), ("working", working)):
        if value is not None:
            raise ValueError(f"--{option} is for Zarr outputs, and {output} is none")
    scan = load_input(source, at, large, spacing)
    check_savable(output, scan.volume)
    if told := lost_place(scan, output):
        typer.echo(f"note: {output.name}: {told}", err=True)
    found = segment(scan.volume, scan.spacing, progress=Ticker(), smallest=smallest, grainy=grainy)
    labelled = scan.with_labels(found.labels)
    try:
        write_somewhere(lambda path: save_scan(labelled, path), output, ".npz")
    finally:
        if csv is not None:
            write_somewhere(lambda path: [save_objects_csv(found.objects, path)], csv, ".csv")
    typer.echo(f"{len(found.objects)} objects")


@_command()
def _train(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="The oracle to write, .npz.")],
    bags: Annotated[
        list[Path],
        typer.Argument(metavar="BAG...", help="Volumes with true labels, such as simulated bags."),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Of the false examples and the fit.")] = 0,
    large: Large = False,
) -> None:
    """Train the confidence of objects on labelled volumes."""
    from napari_unpack import train
    from napari_unpack.segmentation.confidence.oracle import is_oracle

    check_output(output, (".npz",), *bags)
    # What a pattern of the shell gives where OUT was forgotten: the first of the bags.
    if output.exists() and not is_oracle(output):
        raise ValueError(f"{output} is there and is no oracle: name the oracle to write first")
    for path in bags:
        if not path.exists():
            raise FileNotFoundError(f"no such file or folder: {path}")
    oracle = train(LabelledScans(bags, large), seed, Ticker())

    def save(path: Path) -> list[Path]:
        oracle.save(path)
        return [path]

    write_somewhere(save, output, ".npz")


@_command()
def _score(
    truth: Annotated[
        Path, typer.Argument(metavar="TRUTH", help="True labels, such as a simulated bag's .npz.")
    ],
    found: Annotated[Path, typer.Argument(metavar="FOUND", help="Labels to compare with them.")],
    table: Annotated[
        Path | None,
        typer.Option(help="Table of the true objects (.csv with id), such as simulate writes."),
    ] = None,
    by: Annotated[str, typer.Option(help="Column of that table to summarise by.")] = "kind",
    boundary: Annotated[
        bool, typer.Option("--boundary", help="Measure distances between boundaries too.")
    ] = False,
    at: LabelsAt = None,
    large: Large = False,
) -> None:
    """Compare labels with the truth, in all and by kind of object."""
    from napari_unpack.io.scoring import score_report

    true, seen = load_compared(truth, found, at, large)
    assert true.labels is not None, "it was read"
    typer.echo(score_report(true.labels, seen, true.spacing, table, by, boundary))


@_command()
def _order(
    source: Input,
    labels: LabelsOption = None,
    direction: Direction = None,
    view: ViewOption = None,
    count: Annotated[int, typer.Option(min=0, help="How many objects; 0 for all.")] = 0,
    backend: Backend = "auto",
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Print in which order the objects can be unpacked."""
    from napari_unpack.geometry.length_unit import density_text
    from napari_unpack.io.headless import unpack_in_order
    from napari_unpack.io.report import volume_unit_of

    session = open_input(source, labels, direction, view, backend, at, large, spacing)
    volumes = volume_unit_of(session)
    title = "volume " + volumes.name.replace("³", "3")
    typer.echo(f"{'step':>4}  {'id':>5}  {'name':<24}{title:>14}{'density':>9}")
    # A saved session may be unpacked in part: its own steps come first, and count.
    gone = session.steps[: session.step]
    left = max(count - sum(map(len, gone)), 0)
    more = unpack_in_order(session, left or None) if left or not count else ()
    shown = 0
    for step, ids in enumerate((*gone, *more), start=1):
        if count and shown >= count:
            break
        shown += len(ids)
        for i in ids:
            facts = session.objects.loc[i]
            typer.echo(
                f"{step:>4}  {session.label_of(i):>5}  {str(facts['name'])[:23]:<24}"
                f"{volumes.text(float(facts['volume_mm3'])):>14}"
                f"{density_text(facts['mean_density']):>9}"
            )


@_command()
def _render(
    source: Input,
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="Image to write, .png.")],
    labels: LabelsOption = None,
    direction: Direction = None,
    view: ViewOption = None,
    unpacked: Annotated[int, typer.Option(min=0, help="Objects to unpack before.")] = 0,
    size: Annotated[
        tuple[int, int], typer.Option(metavar="H W", help="Height and width, pixels.")
    ] = (960, 1280),
    background: Ground = None,
    box: Box = False,
    scale: Scale = False,
    backend: Backend = "auto",
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Render the bag and what is unpacked beside it."""
    from napari_unpack.io import save_png
    from napari_unpack.io.headless import frame_bag, unpack_in_order
    from napari_unpack.io.session_archive import holds_session
    from napari_unpack.memory import check_picture
    from napari_unpack.rendering.compose import scene_image
    from napari_unpack.session.framing import contained, drawn_back

    check_output(output, (".png",), source, labels, picture_file(background))
    check_picture(size)
    decorated = requested_decorations(background, box, scale)
    session = open_input(source, labels, direction, view, backend, at, large, spacing)
    if decorated is not None:
        session.decorations = decorated
    # A plain volume is framed to show all slots, which follow the picture's shape.
    camera = None if holds_session(source) else frame_bag(session, size)
    was_out = set(session.poses)
    for _ in unpack_in_order(session, unpacked) if unpacked else ():
        pass
    if camera is None:
        # What its user saw and what has come out since, whatever the picture's shape.
        seen = drawn_back(session, session.camera, set(session.poses) - was_out)
        camera = contained(seen, session.canvas_size, size)
    typer.echo(
        f"wrote {save_png(scene_image(session.scene(), camera, size, backend=backend), output)}"
    )


@_command()
def _movie(
    source: Input,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUTPUT", help="Movie to write: .mp4, .gif, or a new folder for PNG images."
        ),
    ],
    labels: LabelsOption = None,
    direction: Direction = None,
    view: ViewOption = None,
    count: Annotated[int, typer.Option(min=0, help="How many objects to unpack; 0 for all.")] = 0,
    size: Annotated[
        tuple[int, int], typer.Option(metavar="H W", help="Height and width, pixels.")
    ] = (720, 960),
    fps: Annotated[int, typer.Option(min=1, help="Frames a second.")] = 25,
    seconds: Annotated[float, typer.Option(help="Of one flight.")] = 0.8,
    turntable: Annotated[
        bool, typer.Option("--turntable", help="Turn the bag once round instead of unpacking it.")
    ] = False,
    turn_seconds: Annotated[float, typer.Option(help="Of one turn of the turntable.")] = 8.0,
    background: Ground = None,
    box: Box = False,
    scale: Scale = False,
    backend: Backend = "auto",
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Make a movie of the unpacking, or of the bag from all around."""
    from napari_unpack.io import movie
    from napari_unpack.io.movies import checked_movie_path

    # Any suffix passes the second check, as a folder of images has none; the first knows movies.
    check_output(
        checked_movie_path(output, size),
        ("",),
        source,
        labels,
        picture_file(background),
        folder=not output.suffix,
    )
    decorated = requested_decorations(background, box, scale)
    session = open_input(source, labels, direction, view, backend, at, large, spacing)
    if decorated is not None:
        session.decorations = decorated
    path = movie(
        session,
        output,
        count=count or None,
        size=size,
        fps=fps,
        seconds=seconds,
        backend=backend,
        progress=Ticker(),
        kind="turntable" if turntable else "unpacking",
        turn_seconds=turn_seconds,
    )
    typer.echo(f"wrote {path}")


@_command()
def _table(
    source: Input,
    output: Annotated[
        Path, typer.Argument(metavar="OUTPUT", help="Table to write: .html with images, or .csv.")
    ],
    labels: LabelsOption = None,
    view: ViewOption = None,
    measurements: Annotated[
        bool,
        typer.Option(
            "--measurements", help="Write what was measured in a saved session instead, as CSV."
        ),
    ] = False,
    backend: Backend = "auto",
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Write the table of objects, as one web page with an image of each, or as CSV."""
    from napari_unpack.io import save_measurements_csv, save_objects_csv, save_objects_page
    from napari_unpack.io.volumes import printable, stem_of

    check_output(output, (".csv",) if measurements else (".html", ".csv"), source, labels)
    session = open_input(source, labels, None, view, backend, at, large, spacing)
    if measurements:
        if not len(session.measurements):
            typer.echo(f"note: {source.name}: nothing was measured in it", err=True)
        path = save_measurements_csv(session, output)
    elif output.suffix.lower() == ".csv":
        path = save_objects_csv(session, output)
    else:
        path = save_objects_page(session, output, printable(stem_of(source)), Ticker(), backend)
    typer.echo(f"wrote {path}")


@_command()
def _web(
    source: Input,
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="Page to write, .html.")],
    labels: LabelsOption = None,
    direction: Direction = None,
    view: ViewOption = None,
    backend: Backend = "auto",
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Write one web page on which the bag turns and is unpacked, for people without napari."""
    from napari_unpack.io import save_interactive_page
    from napari_unpack.io.volumes import printable, stem_of

    check_output(output, (".html",), source, labels)
    session = open_input(source, labels, direction, view, backend, at, large, spacing)
    title = printable(stem_of(source))
    path = save_interactive_page(session, output, title, Ticker(), backend)
    typer.echo(f"wrote {path}")


@_command()
def _surfaces(
    source: Input,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUTPUT",
            help="Surfaces to write: .stl, .obj, .ply, .glb, or a folder of one STL an object.",
        ),
    ],
    labels: LabelsOption = None,
    objects: Annotated[
        str | None, typer.Option(metavar="ID,ID", help="Which objects; all without it.")
    ] = None,
    spacing: SpacingOption = None,
    at: At = None,
    large: Large = False,
) -> None:
    """Write the surfaces of objects, in mm and as they were scanned, for other tools."""
    from napari_unpack.io.session_archive import holds_session
    from napari_unpack.io.sessions import standing_of
    from napari_unpack.io.surfaces import FORMATS, checked_surfaces_path, save_surfaces

    check_output(checked_surfaces_path(output), FORMATS, source, labels, folder=not output.suffix)
    session = open_input(source, labels, None, None, "auto", at, large, spacing)
    ids = None
    if objects is not None:
        known = {session.label_of(i): i for i in session.ids}
        asked = [part.strip() for part in objects.split(",")]
        # Not isdigit, which takes ² as well.
        strange = [part for part in asked if not part.isdecimal() or int(part) not in known]
        if strange:
            raise ValueError(f"--objects must be IDs such as 1,4 of the input, got {strange[0]!r}")
        ids = [known[int(part)] for part in asked]
    place = standing_of(source) if holds_session(source) else None
    typer.echo(f"wrote {save_surfaces(session, output, ids, place, Ticker())}")


@_command()
def _batch(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="INPUT...",
            help="Volumes, folders of them, DICOM folders, patterns, or a table (.csv, .parquet) "
            "with columns volume and, where wanted, labels, spacing, name.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for all that is made.")],
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Dask cluster to use, tcp://HOST:PORT or a scheduler file; by default as many "
            "workers on this machine as fit its cores and memory.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Scans at once on this machine.")
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads of a scan.")] = None,
    smallest: Annotated[
        float | None, typer.Option(help="Smaller things are no objects, mm^3, as of segment.")
    ] = None,
    grainy: Annotated[
        bool | None, typer.Option("--grainy/--plain", help="Noisy or not, as of segment.")
    ] = None,
    direction: Direction = None,
    view: NewView = None,
    pictures: Annotated[
        bool, typer.Option(help="A picture of each scan and a page of its objects.")
    ] = True,
    film: Annotated[bool, typer.Option("--film", help="A film of each unpacking.")] = False,
    labels: Annotated[str, typer.Option(help="How labels are written: npz or zarr.")] = "npz",
    copies: Annotated[
        bool,
        typer.Option(
            "--copies/--no-copies",
            help="Sessions hold a copy of their volume, or refer to its file.",
        ),
    ] = True,
    large: Annotated[
        bool, typer.Option("--large", help="Try scans too that seem too big for a worker.")
    ] = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Use the folder even where it holds a run with other settings."
        ),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON line a scan on stdout.")] = False,
) -> None:
    """Segment and unpack many scans; started again, it goes on where it stopped.

    The exit status is 0 where all scans succeeded, 3 where some did, 4 where none did.
    """
    from napari_unpack.batches import batch
    from napari_unpack.batches.terminal import ScanLines
    from napari_unpack.geometry.view import FROM_ABOVE

    lines = ScanLines(json)
    with lines:
        report = batch(
            inputs,
            output,
            scheduler=scheduler,
            workers=workers,
            threads=threads,
            smallest=smallest,
            grainy=grainy,
            direction=direction_of(direction),
            view=view or FROM_ABOVE,
            pictures=pictures,
            film=film,
            labels=labels,
            copies=copies,
            large=large,
            force=force,
            told=lines.told,
            say=lines.say,
        )
    failed, count = len(report.failed), len(report.results)
    lines.say(f"{count - failed} of {count} scans done; wrote {report.index}")
    # Not 2, which says that the command was not understood.
    raise typer.Exit(0 if not failed else 3 if failed < count else 4)


@_command()
def _open(
    source: Annotated[
        Path,
        typer.Argument(metavar="SESSION|FOLDER", help="Saved session, or what batch made."),
    ],
    scan: Annotated[
        str | None, typer.Option(metavar="NAME", help="Which scan of a folder of several.")
    ] = None,
) -> None:
    """Go on with a saved session, or with a scan that batch is done with, in napari."""
    from napari_unpack.batches.results import session_in
    from napari_unpack.viewer.screen import check_screen

    path = session_in(source, scan)
    # Before anything has looked for a screen.
    check_screen()
    import napari

    from napari_unpack.widgets.contributions import open_dropped

    napari.Viewer(title=scan or path.stem)
    open_dropped(str(path))
    napari.run()


@_command()
def _demo(
    source: Annotated[
        Path | None, typer.Argument(metavar="[INPUT]", help="Volume; a simulated bag without it.")
    ] = None,
    labels: LabelsOption = None,
    output: Annotated[
        Path, typer.Option(help="Folder for images and movie of a virtual screen.")
    ] = Path("demo-output"),
    seed: Annotated[int, typer.Option(help="Of the simulated bag.")] = 0,
    large: Large = False,
) -> None:
    """Open the plugin on a bag; on a virtual screen, as `make demo` has one, film it."""
    from napari_unpack.demo import run

    run(source, labels, output, seed, large)


@_command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def _bench(context: typer.Context) -> None:
    """Measure speed and accuracy (in a checkout)."""
    root = Path(__file__).parents[2]
    if not (root / "benchmarks" / "__main__.py").exists():
        raise ValueError("benchmarks are not installed with the package; run this in a checkout")
    # Benchmarks stand in a checkout and are not part of the package.
    sys.path.insert(0, str(root))
    from benchmarks.__main__ import main as measure

    raise typer.Exit(measure(context.args))
