"""Real volumes that are not part of the project: a folder beside it has them, or UNPACK_DATA."""

import os
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(os.environ.get("UNPACK_DATA", Path(__file__).parents[3] / "shared" / "data"))


def real_scan(name):
    """Return the arrays of a scan by name, or skip the test where there is no such file."""
    path = FOLDER / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"no {path.name} beside the project; set UNPACK_DATA to a folder that has it")
    with np.load(path) as data:
        return {key: data[key] for key in data.files}
