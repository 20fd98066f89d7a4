"""The model of a session's confidence as plain data, and back."""

from __future__ import annotations

from base64 import b64decode, b64encode
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.json_fields import Fields

if TYPE_CHECKING:
    from napari_unpack.segmentation import Oracle
    from napari_unpack.session import Session


def model_record(session: Session) -> dict[str, Any]:
    """Return what a session's file says of its own model; nothing where it uses the built-in one.

    Nor of a function that somebody wrote: no file can hold it.
    """
    if session.label_editor.oracle is None:
        return {}
    from napari_unpack.segmentation.confidence.features import FEATURES
    from napari_unpack.segmentation.confidence.oracle import FORMAT, Oracle

    oracle = session.label_editor.oracle
    if not isinstance(oracle, Oracle):
        return {}
    # In the manifest: a file of its own would keep older programs from opening the session.
    arrays = {name: _record(array) for name, array in oracle.arrays().items()}
    return {"model": {"format": FORMAT, "features": list(FEATURES), "arrays": arrays}}


def model_from(fields: Fields) -> Oracle | None:
    """Make the model that `model_record` was made of; None where it is of another version.

    Parameters
    ----------
    fields : Fields
        Of the session's file, where it says something of a model.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    from napari_unpack.segmentation.confidence.features import FEATURES
    from napari_unpack.segmentation.confidence.oracle import ARRAYS, FORMAT, Oracle

    told = fields.part("model")
    if told.text("format") != FORMAT or told.texts("features") != FEATURES:
        return None
    arrays = told.part("arrays")
    found = {name: _array(arrays.part(name), name) for name in ARRAYS if arrays.has(name)}
    return Oracle.of_arrays(found, "the session's model of the confidence")


def restore_model(session: Session, fields: Fields) -> None:
    """Have a session go on by the model that its file holds.

    Parameters
    ----------
    session : Session
        With the confidences of the file.
    fields : Fields
        Of the file; older ones say nothing of a model.
    """
    if not fields.has("model"):
        return
    oracle = model_from(fields)
    if oracle is None:
        # Its numbers would stand beside those of the built-in one, which scores what is repaired.
        session.use_oracle(None, {})
    else:
        session.label_editor.oracle = oracle


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
