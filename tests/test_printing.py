"""What commands print where a terminal, or what it is piped into, has few letters."""

from __future__ import annotations

import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np
import pytest

from napari_unpack.cli import main
from napari_unpack.io import Scan, save_scan


def test_names_that_cannot_be_printed_stop_no_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = np.zeros((12, 12, 24), np.uint8)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 13:21] = 1, 2
    scan = Scan(1000.0 * (labels > 0), (1.0, 1.0, 1.0), labels, names={1: "Ключи", 2: "Schlüssel"})
    save_scan(scan, tmp_path / "bag.npz")
    printed = BytesIO()
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(printed, "cp1252"))
    monkeypatch.setattr(sys, "argv", ["napari-unpack", "order", str(tmp_path / "bag.npz")])
    with pytest.raises(SystemExit) as end:
        main()
    sys.stdout.flush()
    assert end.value.code == 0
    title, *lines = printed.getvalue().decode("cp1252").splitlines()
    assert title.split()[:3] == ["step", "id", "name"]
    assert {line.split()[2] for line in lines} == {"?????", "Schlüssel"}
