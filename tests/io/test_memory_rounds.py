"""Sessions that are opened, unpacked and saved again and again leave nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from memory_rounds import MOST_BLOCKS, MOST_BYTES, growth, rounds


def test_twenty_rounds_of_open_unpack_and_save_keep_nothing(tmp_path: Path) -> None:
    blocks, size = growth(list(rounds(20, tmp_path)))
    assert blocks <= MOST_BLOCKS
    assert size <= MOST_BYTES


def test_a_session_that_is_kept_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import memory_rounds

    opened, kept = memory_rounds.open_session, []
    monkeypatch.setattr(
        memory_rounds, "open_session", lambda file: kept.append(opened(file)) or kept[-1]
    )
    _, size = growth(list(rounds(7, tmp_path)))
    assert size > MOST_BYTES
