"""A person's review of doubtful decisions: what to ask, what an answer does, and what it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.appearance.decorations import Decorations
from napari_unpack.appearance.tints import Rgba
from napari_unpack.geometry.axes import triple
from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.geometry.view import GRAVITY_UP, Camera, View
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.slice_image import PLANES, slice_image, window_for
from napari_unpack.segmentation.repair import LabelEdit, edit_of_answer
from napari_unpack.segmentation.review.doubts import (
    Answer,
    Doubt,
    Said,
    doubts,
    still_asked,
)
from napari_unpack.segmentation.review.evidence import Evidence
from napari_unpack.tasks import Task

if TYPE_CHECKING:
    from napari_unpack.session.document import Document
    from napari_unpack.session.label_edits import EditedLabels, LabelEditor
    from napari_unpack.session.labels import LabelData
    from napari_unpack.session.session import Session

# Of the first side and the second, told apart also where red looks green (Okabe and Ito 2008).
FIRST: Rgba = (0.90, 0.62, 0.0, 1.0)
SECOND: Rgba = (0.0, 0.45, 0.70, 1.0)
# Voxels from the contact to the edge of a close-up, at least and at most.
NEAREST, FURTHEST = 12, 48
# Behind both pictures of a close-up, as air is in slices. Between them, of a side; and of its
# picture, how much of it both sides fill in 3D.
BLACK, BETWEEN, FILLED = "#000000", 1 / 34, 0.92


@dataclass(frozen=True)
class DoubtsKey:
    """What the doubts depend on.

    Parameters
    ----------
    revision : int
        Of the labels.
    answers : tuple of Answer
    """

    revision: int
    answers: tuple[Answer, ...]


class Review:
    """Doubts about a session's labels, and answers to them, each applied at once and undoable.

    Parameters
    ----------
    document : Document
    editor : LabelEditor

    Attributes
    ----------
    evidence : Evidence, optional
        From the segmentation; without it there is nothing to review.
    """

    def __init__(self, document: Document, editor: LabelEditor) -> None:
        self._doc, self._editor = document, editor
        self.evidence: Evidence | None = None

    @property
    def answers(self) -> tuple[Answer, ...]:
        """Given so far and not undone."""
        return self._doc.state.answers

    def doubts_task(self) -> Task[list[Doubt]] | None:
        """Return the task that finds what is doubtful now; None without evidence."""
        evidence, data, answers = self.evidence, self._doc.label_data, self.answers
        if evidence is None or evidence.shape != data.labels.shape:
            return None
        key = DoubtsKey(data.revision, answers)

        def find(_: object) -> list[Doubt]:
            found = doubts(evidence, data.labels, answers)
            return [replace(doubt, revision=data.revision) for doubt in found]

        return Task(key, find)

    def answer_task(self, doubt: Doubt, said: Said) -> Task[EditedLabels | None]:
        """Return the task that works out what an answer changes; None where that is nothing.

        Parameters
        ----------
        doubt : Doubt
        said : {"same", "different", "nothing", "skip"}

        Raises
        ------
        ValueError
            If there is nothing to review, or an object of it is outside the bag; from the task
            too, if its objects are no more what they were when it was asked.
        """
        evidence = self.evidence
        if evidence is None:
            raise ValueError(
                "there is nothing to review: only labels that Segment found here have doubts"
            )
        if not doubt.changed_by(said):
            return Task(("review", doubt.pieces, said), lambda _: None)
        wanted = [i for i in doubt.objects if i]

        def change(data: LabelData, new_id: int) -> LabelEdit | None:
            _refuse_stale(doubt, evidence, data)
            return edit_of_answer(doubt, said, evidence, data.labels, data.boxes, new_id)

        return self._editor.change_task("review", wanted, change)

    def apply(self, doubt: Doubt, said: Said, edited: EditedLabels | None) -> bool:
        """Take an answer; return False where the labels it is about have changed meanwhile.

        Parameters
        ----------
        doubt : Doubt
        said : {"same", "different", "nothing", "skip"}
        edited : EditedLabels, optional
            What `answer_task` gave.
        """
        answers = (*self.answers, doubt.answered(said))
        if edited is not None:
            return self._editor.apply(edited, answers)
        self._doc.commit("review", replace(self._doc.state, answers=answers))
        return True

    def picture_task(self, doubt: Doubt, side: int) -> Task[NDArray[np.uint8]]:
        """Return the task that draws a doubt close up.

        Parameters
        ----------
        doubt : Doubt
        side : int
            Pixels: of each of its two square pictures, between which nothing is drawn.
        """
        evidence, data = self.evidence, self._doc.label_data
        volume, mm = self._doc.volume, self._doc.spacing
        assert evidence is not None, "a doubt comes from evidence"

        def draw(_: object) -> NDArray[np.uint8]:
            _refuse_stale(doubt, evidence, data)
            near = _close_by(evidence.pieces, data.labels, data.boxes, doubt)
            return _drawn(np.asarray(volume[near.box]), near, mm, side)

        return Task(("close-up", data.revision, doubt.pieces, side), draw)


def _refuse_stale(doubt: Doubt, evidence: Evidence, data: LabelData) -> None:
    # To look takes as long as to find the doubts anew.
    if doubt.revision != data.revision and not still_asked(doubt, evidence, data.labels):
        raise ValueError(
            "the objects of this question have changed since it was asked: ask for the doubts again"
        )


@dataclass(frozen=True, eq=False)
class _CloseUp:
    """Where two sides meet: a box, in it 1 and 2 for the sides, its middle, and across."""

    box: tuple[slice, ...]
    sides: NDArray[np.uint16]
    middle: NDArray[np.int64]
    across: NDArray[np.float64]


def _close_by(
    pieces: NDArray[np.int32], labels: NDArray[np.uint16], boxes: LabelBoxes, doubt: Doubt
) -> _CloseUp:
    """Find what a close-up shows."""
    one, two = doubt.objects
    around = boxes.around(i for i in doubt.objects if i)
    first = labels[around] == one
    second = labels[around] == two if two else np.zeros_like(first)
    if doubt.kind == "join":
        first = first & np.isin(pieces[around], doubt.side)
        second = second & ~first
    sides = np.where(first, 1, np.where(second, 2, 0)).astype(np.uint16)
    faces = [
        np.argwhere((here := np.moveaxis(sides, k, 0))[:-1].astype(int) + here[1:] == 3)
        for k in range(3)
    ]
    # `moveaxis` puts the axis first; the spots go back the same way.
    spots = np.concatenate(
        [np.insert(f[:, 1:], k, f[:, 0], axis=1) for k, f in enumerate(faces)]
        + ([] if any(map(len, faces)) else [np.argwhere(sides == 1)])
    )
    middle = spots[np.linalg.norm(spots - spots.mean(axis=0), axis=1).argmin()]
    # As far as the smaller side is wide, so that it is known again.
    reach = int(np.clip(1.2 * np.cbrt(float((sides == 1).sum())), NEAREST, FURTHEST))
    start = np.maximum(middle - reach, 0)
    window = tuple(slice(int(a), int(m) + reach + 1) for a, m in zip(start, middle, strict=True))
    shown = sides[window]
    ends = [np.argwhere(shown == k).mean(axis=0) for k in (1, 2) if (shown == k).any()]
    across = ends[1] - ends[0] if len(ends) == 2 else np.array([0.0, 0.0, 1.0])
    box = tuple(
        slice(a.start + w.start, a.start + w.start + n)
        for a, w, n in zip(around, window, shown.shape, strict=True)
    )
    return _CloseUp(box, shown, middle - start, across)


def _drawn(
    volume: NDArray[Any], near: _CloseUp, mm: NDArray[np.float64], side: int
) -> NDArray[np.uint8]:
    """Draw both sides in 3D, and beside it the slice through where they meet, RGBA."""
    from napari_unpack.session.session import Session

    # As clay: what is shown is shape, and the slice beside it shows the densities.
    # Air around, where the cut through an object then is a surface too.
    sides = np.pad(near.sides, 2)
    clay = 2000 * gaussian_filter((sides > 0).astype(np.float32), 0.7)
    # Whole numbers: the kernels for them are compiled already.
    session = Session(clay.astype(np.uint16), sides, mm)
    across = near.across * mm
    # From aside, so that one side stands beside the other and hides nothing of it.
    up = np.array(GRAVITY_UP)
    looking = np.cross(across, up)
    if np.linalg.norm(looking) < 0.3 * np.linalg.norm(across):
        looking = np.array([1.0, 0.0, 0.0])
    session.view = View(triple(looking / np.linalg.norm(looking)))
    scene = replace(session.scene(), colors={1: FIRST, 2: SECOND})
    around = Decorations.of(BLACK)
    solid = scene_image(scene, _close(session), (side, side), backend="cpu", decorations=around)
    solid = np.clip(np.rint(255 * np.asarray(solid)), 0, 255).astype(np.uint8)
    # The plane that cuts both sides: across lies in it as well as it can.
    plane = min(PLANES, key=lambda p: abs(float(across[p.normal])))
    tints = np.array([(0, 0, 0, 0), (*FIRST[:3], 0.45), (*SECOND[:3], 0.45)], np.float32)
    index = int(near.middle[plane.normal])
    flat = slice_image(volume, near.sides, tints, plane, index, window_for(volume))
    lengths = np.array(flat.shape[:2]) * mm[[plane.rows, plane.cols]]
    size = np.maximum(np.rint(side * lengths / lengths.max()).astype(int), 1)
    spots = [np.arange(n) * old // n for n, old in zip(size, flat.shape, strict=False)]
    canvas = np.zeros((side, side, 4), np.uint8)
    canvas[..., 3] = 255
    top, left = (side - size) // 2
    canvas[top : top + size[0], left : left + size[1]] = flat[np.ix_(*spots)]
    between = np.zeros((side, max(1, round(BETWEEN * side)), 4), np.uint8)
    return np.concatenate([solid, between, canvas], axis=1)


def _close(session: Session) -> Camera:
    """Return a session's camera where what it sees, orthographically, fills a square picture."""
    camera = session.camera
    seen = (session.bag.silhouette - camera.center) @ camera.rotation.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    height = float(np.ptp(seen[:, 1:], axis=0).max()) / FILLED
    return replace(camera, center=camera.center + middle @ camera.rotation, height=height)
