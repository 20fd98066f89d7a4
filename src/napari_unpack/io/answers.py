"""A person's review as plain data and back: its answers, what it starts from, training data."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args
from zlib import decompressobj
from zlib import error as ZlibError

import numpy as np

from napari_unpack.atomic import given_path, written_atomically
from napari_unpack.io.json_fields import Fields
from napari_unpack.segmentation.review.doubts import SAID, Answer, Kind
from napari_unpack.segmentation.review.evidence import Evidence
from napari_unpack.segmentation.review.rescoring import FEATURES

if TYPE_CHECKING:
    from napari_unpack.session import Session

FORMAT = "napari-unpack answers 1"
TABLES = ("sums", "pairs", "contact", "chance", "tree")
KINDS: tuple[Kind, ...] = get_args(Kind)


def answers_record(answers: Iterable[Answer]) -> list[dict[str, Any]]:
    """Return answers as plain data."""
    return [
        {
            "kind": one.kind,
            "pieces": list(one.pieces),
            "said": one.said,
            "chance": one.chance,
            "row": list(one.row),
        }
        for one in answers
    ]


def answers_from(fields: Fields) -> tuple[Answer, ...]:
    """Make the answers a record was made of; none where older files say nothing of them."""
    if not fields.has("answers"):
        return ()
    return tuple(_answer(one) for one in fields.parts("answers"))


def _answer(fields: Fields) -> Answer:
    kind, said = fields.text("kind", KINDS), fields.text("said", SAID)
    one, two = (int(v) for v in fields.array("pieces", (2,)))
    row = fields.array("row", (len(FEATURES),)).tolist()
    return Answer(kind, (one, two), said, fields.number("chance"), tuple(row))  # type: ignore[arg-type]


def evidence_record(evidence: Evidence) -> dict[str, Any]:
    """Return evidence as plain data."""
    # In the manifest: a file of its own would keep older programs from opening the session.
    pieces = {"shape": list(evidence.shape), "pieces": b64encode(evidence.packed).decode()}
    return pieces | {name: getattr(evidence, name).tolist() for name in TABLES}


def evidence_from(fields: Fields, shape: tuple[int, ...]) -> Evidence:
    """Make the evidence a record was made of.

    Parameters
    ----------
    fields : Fields
    shape : (int, int, int)
        Of the labels.

    Raises
    ------
    ValueError
        If it is of another shape, or its tables do not fit the pieces or each other.
    """
    if tuple(fields.array("shape", (3,)).tolist()) != shape:
        raise ValueError(f"evidence must have the labels' shape {shape}, got {fields['shape']}")
    size = 4 * int(np.prod(shape))
    try:
        # No more than fits: what is compressed may be anything.
        data = decompressobj().decompress(b64decode(fields.text("pieces")), size + 1)
    except (ValueError, ZlibError) as error:
        raise ValueError(f"the evidence is damaged: its pieces cannot be read: {error}") from error
    if len(data) != size:
        raise ValueError(f"the evidence is damaged: its pieces must have {size} bytes")
    pieces = np.frombuffer(data, "<i4").reshape(shape)
    count, width = len(fields.items("pairs")), len(fields.items("sums"))
    sums, pairs = fields.array("sums", (width, 5)), fields.array("pairs", (count, 2))
    contact = fields.array("contact", (count, 3))
    chance, tree = fields.array("chance", (count,)), fields.array("tree", (count,))
    top = max(float(pieces.max(initial=0)), float(pairs.max(initial=0)))
    least = min(float(pieces.min(initial=0)), float(pairs.min(initial=0)))
    if top >= width or least < 0:
        raise ValueError(f"evidence must be of pieces from 0 to {width - 1}, got {least} to {top}")
    return Evidence.of(
        pieces.astype(np.int32), sums, pairs.astype(np.int64), contact, chance, tree > 0
    )


def save_answers(session: Session, path: str | Path) -> Path:
    """Write the answers of a review as training data: an .npz of plain arrays.

    Parameters
    ----------
    session : Session
    path : str or Path

    Returns
    -------
    Path
        The file: `features` (names), `rows` (N, F), `kinds`, `said` and `chances` (N,).

    Raises
    ------
    ValueError
        If nothing was answered yet.
    """
    answers, target = session.review.answers, given_path(path)
    if not answers:
        raise ValueError("there are no answers to save: answer a question of the review first")
    with written_atomically(target) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            format=FORMAT,
            features=np.array(FEATURES),
            rows=np.array([one.row for one in answers]),
            kinds=np.array([one.kind for one in answers]),
            said=np.array([one.said for one in answers]),
            chances=np.array([one.chance for one in answers]),
        )
    return target
