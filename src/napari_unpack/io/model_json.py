"""The model of a session's confidence as plain data, and back."""

from __future__ import annotations

import warnings
from base64 import b64decode, b64encode
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.json_fields import Fields

if TYPE_CHECKING:
    from napari_unpack.segmentation import Oracle
    from napari_unpack.session import Session


BUILT_IN = "built-in"


@dataclass(frozen=True)
class SavedModel:
    """What a file says of the model of a session's confidences.

    Parameters
    ----------
    rated : bool
        Whether the confidences are by a model; else they are as they were given.
    oracle : Oracle, optional
        The model; None is the built-in one.
    lost : bool
        Whether the file's numbers are by another one, which this version cannot use.
    """

    rated: bool = False
    oracle: Oracle | None = None
    lost: bool = False

    def give_to(self, session: Session) -> None:
        """Have a session with the file's confidences go on by it."""
        if self.lost:
            # Its numbers would stand beside those of the built-in one, which scores all anew.
            session.use_oracle(None, {})
        elif self.rated:
            session.label_editor.oracle = self.oracle


def model_record(session: Session, around: Session | None = None) -> dict[str, Any]:
    """Return what a session's file says of the model of its confidences.

    Nothing where they are as they were given, and where they are by a function that somebody
    wrote: no file can hold it.

    Parameters
    ----------
    session : Session
    around : Session, optional
        The bag that it is the inside of an object of. Nothing is said of its model again.
    """
    from napari_unpack.segmentation.confidence.features import FEATURES
    from napari_unpack.segmentation.confidence.oracle import FORMAT, Oracle

    if around is not None and _scored_alike(session, around):
        return {}
    oracle = session.label_editor.oracle
    if oracle is None and session.label_data.rating is not None:
        return {"model": {"format": BUILT_IN}}
    if isinstance(oracle, Oracle):
        # In the manifest: a file of its own would keep older programs from opening the session.
        arrays = {name: _record(array) for name, array in oracle.arrays().items()}
        return {"model": {"format": FORMAT, "features": list(FEATURES), "arrays": arrays}}
    return {} if around is None else {"model": None}


def saved_model(fields: Fields, around: SavedModel | None = None) -> SavedModel:
    """Make what `model_record` was made of.

    Parameters
    ----------
    fields : Fields
        Of the session's file; older ones say nothing of a model.
    around : SavedModel, optional
        Of the bag that the session is the inside of an object of.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    if not fields.has("model"):
        return SavedModel() if around is None or fields.holds("model") else around
    from napari_unpack.segmentation.confidence.features import FEATURES
    from napari_unpack.segmentation.confidence.oracle import ARRAYS, FORMAT, Oracle

    told = fields.part("model")
    if told.text("format") == BUILT_IN:
        return SavedModel(rated=True)
    if told.text("format") != FORMAT or told.texts("features") != FEATURES:
        warnings.warn(
            "the session's confidences are by a model of another version, which cannot be used: "
            "the built-in one scores the objects anew",
            stacklevel=2,
        )
        return SavedModel(rated=True, lost=True)
    arrays = told.part("arrays")
    found = {name: _array(arrays.part(name), name) for name in ARRAYS if arrays.has(name)}
    source = "the session's model of the confidence"
    return SavedModel(rated=True, oracle=Oracle.of_arrays(found, source))


def _scored_alike(a: Session, b: Session) -> bool:
    """Return whether the confidences of both are by the same model, or of both as given."""
    alike = a.label_editor.oracle is b.label_editor.oracle
    return alike and (a.label_data.rating is None) == (b.label_data.rating is None)


def _record(array: NDArray[np.float64]) -> dict[str, Any]:
    data = b64encode(array.astype("<f8").tobytes())
    return {"shape": list(array.shape), "float64": data.decode()}


def _array(fields: Fields, name: str) -> NDArray[np.float64]:
    try:
        data = b64decode(fields.text("float64"), validate=True)
        shape = [int(n) for n in fields.items("shape")]
        return np.frombuffer(data, "<f8").reshape(shape).astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"the session's model is damaged: {name} cannot be read") from error
