"""Step 5: save and open sessions; export pictures, movies, reports and tables."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from napari.layers import Labels
from qtpy.QtWidgets import QFileDialog, QMenu, QSpinBox

from napari_unpack.file_sizes import TooLargeError
from napari_unpack.io.session_archive import ZIP_SUFFIXES
from napari_unpack.tasks import Progress, Share, TaskResult
from napari_unpack.viewer.warm_up import color_labels
from napari_unpack.widgets import notifications
from napari_unpack.widgets.contributions import told_of_file
from napari_unpack.widgets.file_names import FileNames, ask_where_to_write
from napari_unpack.widgets.large_files import ask_about_size
from napari_unpack.widgets.preferences import preferences
from napari_unpack.widgets.repair_tools import RepairTools
from napari_unpack.widgets.section import Collapsible, Section, button, form, row
from napari_unpack.widgets.task_progress import TaskProgress
from napari_unpack.widgets.unsaved_work import Call, UnsavedWork
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from qtpy.QtGui import QAction

    from napari_unpack.geometry.axes import Matrix
    from napari_unpack.geometry.view import Camera
    from napari_unpack.io.label_names import NamedLabel
    from napari_unpack.io.recovery import Leftover
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController


@dataclass(frozen=True)
class ExportOptions:
    """How exports are made.

    Parameters
    ----------
    size : (int, int)
        Height and width, pixels.
    fps, seconds : int, float
        Frames a second, and the duration of one flight.
    selected : tuple of int
        The objects that are selected.
    standing : (4, 4) ndarray, optional
        How the bag stands where its layers were moved or turned.
    """

    size: tuple[int, int]
    fps: int
    seconds: float
    selected: tuple[int, ...] = ()
    standing: Matrix | None = None


@dataclass(frozen=True)
class Export:
    """One kind of export.

    Parameters
    ----------
    title : str
        In menus.
    word : str
        Tells its files from others of the bag; empty for the bag itself.
    suffixes : tuple of str
        Of its files, the usual one first.
    write : callable
        (session, path, options, progress) -> path; runs in a worker, on a session of its own.
    there : callable, optional
        Tells whether a session has something to be written.
    """

    title: str
    word: str
    suffixes: tuple[str, ...]
    write: Callable[[Session, Path, ExportOptions, Progress], Path]
    there: Callable[[Session], bool] = lambda session: True


# Workers have no GL context of the viewer's, so exports are drawn by the processor.


def _picture(session: Session, path: Path, options: ExportOptions, progress: Progress) -> Path:
    from napari_unpack.io import save_png
    from napari_unpack.rendering.compose import scene_image
    from napari_unpack.rendering.cpu import CANCELLING
    from napari_unpack.session.framing import contained

    drawing = Share(progress).part(0.0, 0.9, "Drawing the picture")
    session.leave()
    # All that the window shows, whatever the picture's shape.
    camera = contained(session.camera, session.canvas_size, options.size)
    with CANCELLING.by(drawing):
        image = scene_image(session.scene(), camera, options.size, backend="cpu")
    progress(0.9, "Writing the picture")
    return save_png(image, path)


def _movie(
    session: Session,
    path: Path,
    options: ExportOptions,
    progress: Progress,
    kind: str = "unpacking",
    done: bool = False,
) -> Path:
    from napari_unpack.io import movie

    return movie(
        session,
        path,
        count=sum(map(len, session.steps)) if done else None,
        size=options.size,
        fps=options.fps,
        seconds=options.seconds,
        backend="cpu",
        progress=progress,
        kind=kind,
        window=session.canvas_size,
    )


def _report(session: Session, path: Path, options: ExportOptions, progress: Progress) -> Path:
    from napari_unpack.io import save_objects_page

    return save_objects_page(session, path, path.stem, progress, backend="cpu")


def _interactive(session: Session, path: Path, options: ExportOptions, progress: Progress) -> Path:
    from napari_unpack.io import save_interactive_page

    return save_interactive_page(session, path, path.stem, progress, backend="cpu")


def _table(session: Session, path: Path, options: ExportOptions, progress: Progress) -> Path:
    from napari_unpack.io import save_objects_csv

    progress(0.0, "Writing the table")
    return save_objects_csv(session, path)


def _measurements(session: Session, path: Path, options: ExportOptions, progress: Progress) -> Path:
    from napari_unpack.io import save_measurements_csv

    progress(0.0, "Writing the measurements")
    return save_measurements_csv(session, path)


def _surfaces(
    session: Session, path: Path, options: ExportOptions, progress: Progress, some: bool = False
) -> Path:
    from napari_unpack.io.surfaces import save_surfaces

    ids = options.selected if some else None
    return save_surfaces(session, path, ids, options.standing, progress)


MOVIES = (".mp4", ".gif")
MESHES = (".stl", ".obj", ".ply", ".glb")
EXPORTS = (
    Export("Picture", "", (".png",), _picture),
    Export("Movie of the unpacking", "unpacking", MOVIES, _movie),
    Export(
        "Movie of the steps so far",
        "steps",
        MOVIES,
        partial(_movie, done=True),
        lambda s: len(s.steps) > 0,
    ),
    Export("Movie of the bag turning", "turning", MOVIES, partial(_movie, kind="turntable")),
    Export("Web page", "objects", (".html",), _report),
    Export("Interactive page", "interactive", (".html",), _interactive),
    Export("Table", "objects", (".csv",), _table),
    Export(
        "Measurements", "measurements", (".csv",), _measurements, lambda s: len(s.measurements) > 0
    ),
    Export("Surfaces of all objects", "surfaces", MESHES, _surfaces),
    Export(
        "Surfaces of the selected objects",
        "selected surfaces",
        MESHES,
        partial(_surfaces, some=True),
        lambda s: bool(s.selected),
    ),
)

# Of the one file at a time.
BUSY = "Wait for the file that is being read or written, or cancel it."

WHOLE = "Session with its volume (*.unpack *.zip)"
REFERRING = "Small session that refers to the volume's file (*.unpack *.zip)"


@dataclass(frozen=True, eq=False)
class _Opened:
    """A session read from a file, and how its volume is shown.

    Parameters
    ----------
    session : Session
    labels : ndarray
        Of the layer.
    affine : (4, 4) ndarray, optional
        How it stands.
    shown_range : (float, float)
        Densities, black and white.
    camera : Camera, optional
        How it was looked at; None where all was brought into view, whatever the window.
    """

    session: Session
    labels: NDArray[Any]
    affine: Matrix | None
    shown_range: tuple[float, float]
    camera: Camera | None


def _opened(path: Path, large: bool, progress: Progress) -> _Opened:
    from napari_unpack.io import open_session
    from napari_unpack.io.session_json import given_labels
    from napari_unpack.io.sessions import standing_of
    from napari_unpack.rendering.slice_image import object_window
    from napari_unpack.session.framing import alike, fitted

    session = open_session(path, progress=progress, large=large)
    labels = given_labels(session)
    color_labels(labels.dtype, len(session.ids))
    # Here, in the worker: the layer's labels are not to be ours, and the bag's hull is found.
    session.own_labels([labels])
    # Without a height nobody has looked at it yet, as where a script saved it.
    whole = session.view.height is None or alike(session.camera, fitted(session))
    # A session saved during an inspection opens with the whole bag.
    camera = None if whole or session.state.inspected is not None else session.camera
    session.leave()
    shown = object_window(session.volume, session.labels)
    return _Opened(session, labels, standing_of(path), shown, camera)


class FilesSection(Section):
    """Save, open and export in a worker, with progress and cancel.

    Parameters
    ----------
    workspace : Workspace
    unsaved : UnsavedWork
        Asked before a session is opened in place of another, and told what is saved.
    repair : RepairTools
        What is written waits for it.
    """

    def __init__(self, workspace: Workspace, unsaved: UnsavedWork, repair: RepairTools) -> None:
        super().__init__("5", "Files")
        self._workspace, self._unsaved, self._repair = workspace, unsaved, repair
        unsaved.save = self._ask_save
        self._names = FileNames()
        self._then: Callable[[Any], None] = lambda result: None
        self._failed: Call = lambda: None
        self._again: Call | None = None
        self.open = button("Open session…", "Continue a saved session.")
        self.save = button("Save session…", "Save everything, to continue another day.")
        self.export = button(
            "Export…",
            "Write a picture, a movie, web pages, the table of objects, measurements, or surfaces "
            "(STL, OBJ, PLY, glTF).",
        )
        self.label_names = button(
            "Names and colours…",
            "Give objects the names and colours of a file: a colour table (.ctbl) or segmentation "
            "(.seg.nrrd) of 3D Slicer, or label descriptions of ITK-SNAP.",
        )
        self.menu = QMenu(self)
        for kind in EXPORTS:
            action = self.menu.addAction(f"{kind.title}…")
            action.triggered.connect(partial(self._ask, kind))
            self.menu.aboutToShow.connect(partial(self._enable, action, kind))
        self.export.setMenu(self.menu)
        self.width_px, self.height_px = _pixels(1280), _pixels(960)
        self.fps = QSpinBox()
        self.fps.setRange(1, 60)
        self.fps.setValue(25)
        self.fps.setToolTip("Frames per second of movies.")
        self.progress = TaskProgress(
            workspace.scheduler, "Stop; no unfinished file is left.", "Files"
        )
        controls = (self.open, self.save, self.label_names, self.export)
        self._uses = {control: control.toolTip() for control in controls}
        self._arrange()

        self.open.clicked.connect(self._ask_open)
        self.save.clicked.connect(lambda: self._ask_save())
        self.label_names.clicked.connect(self._ask_names)
        self.progress.ended.connect(self._finish)
        workspace.switched.connect(self._refresh)
        self._refresh()

    def _arrange(self) -> None:
        self.contents.addWidget(row(self.open, self.save))
        self.contents.addWidget(row(self.label_names, self.export))
        more = Collapsible("Size of pictures and movies", "How large exports are, and how smooth.")
        more.contents.addLayout(
            form(Width=self.width_px, Height=self.height_px, Frames_per_second=self.fps)
        )
        self.contents.addWidget(more)
        self.contents.addWidget(self.progress)

    def _enable(self, action: QAction, kind: Export) -> None:
        session = self._workspace.session
        action.setEnabled(session is not None and kind.there(session))

    def _refresh(self) -> None:
        busy, empty = self.progress.running, self._workspace.session is None
        for control, use in self._uses.items():
            lacking = empty and control is not self.open
            control.setEnabled(not busy and not lacking)
            control.setToolTip(BUSY if busy else "Available after step 1." if lacking else use)
        self.lock(None)

    def save_to(self, path: str | Path) -> None:
        """Save the whole bag and its volume in a worker, also where an object of it is open."""
        controller, session = self._workspace.controller, self._workspace.document
        if controller is not None and session is not None:
            self._save(path, False, controller, session)

    def _save(
        self,
        path: str | Path,
        refer: bool,
        controller: SessionController,
        session: Session,
        then: Call = lambda: None,
        cancelled: Call = lambda: None,
    ) -> None:
        write = partial(self._write, path, refer, controller, session, then, cancelled)
        self._once_repaired(write)

    def _once_repaired(self, write: Call) -> None:
        """Write what the session is once the last repair or stroke is in it."""
        if self._repair.running:
            self.set_status("Written once the last repair is done")
        self._repair.once_done(write)

    def _write(
        self,
        path: str | Path,
        refer: bool,
        controller: SessionController,
        session: Session,
        then: Call,
        cancelled: Call,
    ) -> None:
        from napari_unpack.io import save_session
        from napari_unpack.io.headless import snapshot
        from napari_unpack.layers.placement import standing

        files = _files_of(controller) if refer else {}
        note_saved = self._unsaved.mark() if session is self._workspace.document else lambda: None
        # Saved, so that the layers stand in the same place when the session is opened.
        files["standing"] = standing(controller.packed, session.spacing)
        # Of this moment, though written later.
        work = partial(save_session, snapshot(session), path, copy=not refer, **files)

        def saved(written: Path) -> None:
            self._say_written(written)
            self._names.saved(session, written)
            note_saved()
            then()

        self._begin(lambda progress: work(progress=progress), saved, cancelled)

    def open_from(self, path: str | Path) -> None:
        """Open a session in a worker, and show it in the 3D view."""
        file = Path(path)

        def opened(found: _Opened) -> None:
            self._names.opened(found.session, file)
            self._replace(found, file.stem)

        self._read(file, file.name, opened)

    def restore(self, leftover: Leftover, then: Call) -> None:
        """Open an unsaved session that a process left behind, and show it in the 3D view.

        Parameters
        ----------
        leftover : Leftover
        then : callable
            Called with nothing once it is shown.
        """

        def restored() -> None:
            self._unsaved.never_saved()
            then()
            with notifications.errors_shown():
                for object_id in leftover.opened:
                    self._workspace.open_container(object_id)

        self._read(
            leftover.session,
            leftover.name,
            lambda found: self._replace(found, leftover.name, restored),
        )

    def _read(self, path: Path, name: str, then: Callable[[_Opened], None]) -> None:
        def begin(large: bool) -> None:
            work, again = partial(_opened, path, large), partial(begin, True)
            self._begin(work, then, self._unsaved.take_back, again)

        # Before it is read, so that nobody waits to be asked; and after, for changes meanwhile.
        self._unsaved.ask(f"Opening {name} ends it.", partial(begin, False))

    def _replace(self, found: _Opened, name: str, then: Call = lambda: None) -> None:
        self._unsaved.ask(f"Opening {name} ends it.", lambda: self._show(found, name, then))

    def name_from(self, path: str | Path) -> None:
        """Read names and colours of objects in a worker; one undo takes them all back."""
        from napari_unpack.io.label_names import load_label_names

        session, file = self._workspace.session, Path(path)
        if session is None:
            return

        def name(labels: dict[int, NamedLabel]) -> None:
            if not self._shows_still(session):
                return
            # The labels of the file are those that people know.
            ids = {session.label_of(i): i for i in session.ids}
            ours = {ids[label]: about for label, about in labels.items() if label in ids}
            names = {i: about.name for i, about in ours.items() if about.name}
            colors = {i: about.color for i, about in ours.items() if about.color is not None}
            session.annotations.name_and_color(names, colors)
            if not ours:
                notifications.warn(
                    f"{file.name} describes none of the {len(ids)} objects: its labels are "
                    f"{_range(labels)}, and those here {_range(ids)}."
                )
            self.set_status(f"{len(ours)} of {len(ids)} named")

        self._begin(lambda _: load_label_names(file), name)

    def export_to(self, kind: Export, path: str | Path) -> None:
        """Write an export in a worker; the view is not disturbed.

        Parameters
        ----------
        kind : Export
        path : str or Path
        """
        controller = self._workspace.controller
        if controller is not None:
            self._once_repaired(partial(self._export, kind, path, controller))

    def _export(self, kind: Export, path: str | Path, controller: SessionController) -> None:
        from napari_unpack.io.headless import snapshot
        from napari_unpack.layers.placement import standing

        session, size = controller.session, (self.height_px.value(), self.width_px.value())
        options = ExportOptions(
            size,
            self.fps.value(),
            session.seconds,
            tuple(sorted(session.selected)),
            standing(controller.packed, session.spacing),
        )
        # Of this moment, though written later.
        self._begin(partial(kind.write, snapshot(session), Path(path), options), self._say_written)

    def end(self) -> None:
        """Stop all work."""
        self.progress.stop()

    def _begin(
        self,
        work: Callable[[Progress], Any],
        then: Callable[[Any], None],
        failed: Call = lambda: None,
        again: Call | None = None,
    ) -> None:
        # A second file would hide the progress of the first.
        if self.progress.running:
            notifications.inform(BUSY)
            failed()
            return
        self._then, self._failed, self._again = then, failed, again
        # What was done before would be read as what came of this.
        self.set_status("")
        self.progress.begin(work)
        self._refresh()

    def _finish(self, outcome: TaskResult[Any]) -> None:
        self._refresh()
        if outcome.error is not None:
            self._failed()
        if isinstance(outcome.error, TooLargeError) and self._again is not None:
            ask_about_size(self.window(), outcome.error, self._again)
        elif not outcome.cancelled:
            # A format may need a package that is not installed.
            with notifications.errors_shown(ImportError):
                self._then(outcome.get())

    def _say_written(self, path: Path | str) -> None:
        self.set_status(f"{Path(path).name} written")

    def _show(self, found: _Opened, name: str, then: Call) -> None:
        session = found.session
        preferred = preferences()
        session.backend = preferred.backend
        viewer = self._workspace.viewer
        placed: dict[str, Any] = {"scale": tuple(session.spacing), "units": ("mm",) * 3}
        # Hidden, because the 3D view shows the session in their place.
        placed |= {"affine": found.affine, "visible": False}
        shown = {"colormap": "gray", "contrast_limits": found.shown_range}
        placed["metadata"] = told_of_file(session)
        image = viewer.add_image(session.volume, name=name, **shown, **placed)
        labels = viewer.add_labels(found.labels, name=f"{name} objects", **placed)
        self._workspace.open(
            session,
            sources=(image, labels),
            camera=found.camera,
            seconds=session.seconds,
            backend=preferred.backend,
            recolor_at_rest=preferred.recolor_at_rest,
        )
        self.set_status(f"{name} opened")
        then()

    def _ask_open(self) -> None:
        kinds = "Sessions (*.unpack *.zip session.json)"
        path, _ = QFileDialog.getOpenFileName(self, "Open session", self._names.to_open(), kinds)
        if path:
            # A session that is a folder is chosen by the file in it.
            chosen = Path(path)
            self.open_from(chosen.parent if chosen.name == "session.json" else chosen)

    def _ask_names(self) -> None:
        from napari_unpack.io.label_names import SUFFIXES

        kinds = f"Names and colours ({' '.join(f'*{suffix}' for suffix in SUFFIXES)})"
        path, _ = QFileDialog.getOpenFileName(
            self, "Names and colours", self._names.to_open(), kinds
        )
        if path:
            self.name_from(path)

    def _ask_save(self, then: Call = lambda: None, cancelled: Call = lambda: None) -> None:
        # All of the bag: what is done in an open object is part of it.
        controller, session = self._workspace.controller, self._workspace.document
        if controller is None or session is None:
            cancelled()
            return
        # Only a volume that came from a file can be referred to.
        forms = [WHOLE, REFERRING] if "volume_path" in _files_of(controller) else [WHOLE]
        proposed = self._names.to_save(session, controller.sources)
        answer = ask_where_to_write(self, "Save session", proposed, ";;".join(forms), ZIP_SUFFIXES)
        if answer is None:
            cancelled()
            return
        path, form = answer
        # Another session may have come while the dialog was open.
        self._save(path, form == REFERRING, controller, session, then, cancelled)

    def _ask(self, kind: Export, _checked: bool = False) -> None:
        controller = self._workspace.controller
        if controller is None:
            return
        suffixes = " ".join(f"*{suffix}" for suffix in kind.suffixes)
        # An open object is written alone, and is not to replace what was written of its bag.
        words = " ".join((*self._workspace.opened_names, kind.word))
        proposed = self._names.to_write(controller.sources, words, kind.suffixes[0])
        answer = ask_where_to_write(
            self, kind.title, proposed, f"{kind.title} ({suffixes})", kind.suffixes
        )
        if answer is not None and self._shows_still(controller.session):
            self._names.wrote(answer[0])
            self.export_to(kind, answer[0])

    def _shows_still(self, session: Session) -> bool:
        """Return whether a session is shown still, and say so where it is not."""
        shown = self._workspace.session
        if shown is None:
            notifications.warn("Nothing was done: the bag that it was asked for is closed.")
        elif shown is not session:
            notifications.warn(
                "Nothing was done: another bag is shown now than when it was asked for."
            )
        return shown is session


def _files_of(controller: SessionController) -> dict[str, Any]:
    """Return the files that the layers of a session were read from, if any."""
    found: dict[str, Any] = {}
    for layer in controller.sources:
        path = layer.source.path
        # A time point or a colour is no file of its own.
        if path and layer.ndim == 3 and not getattr(layer, "rgb", False):
            found["labels_path" if isinstance(layer, Labels) else "volume_path"] = path
    return found


def _range(labels: Collection[int]) -> str:
    low, high = min(labels), max(labels)
    return str(low) if low == high else f"{low} to {high}"


def _pixels(value: int) -> QSpinBox:
    made = QSpinBox()
    made.setRange(64, 7680)
    made.setSingleStep(64)
    made.setValue(value)
    made.setToolTip("Pixels of exported pictures and movies.")
    return made
