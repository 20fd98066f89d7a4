"""What the plugin says in napari's notices."""

from __future__ import annotations

from datetime import timedelta

import pytest
from napari.utils.notifications import notification_manager

from napari_unpack.widgets import notifications


@pytest.fixture
def records():
    kept = list(notification_manager.records)
    notification_manager.records.clear()
    yield notification_manager.records
    notification_manager.records[:] = kept


def test_what_stands_there_already_is_not_said_again(records) -> None:
    for _ in range(3):
        notifications.inform("There is nothing to undo.")
    notifications.warn("Cup cannot leave.")
    notifications.inform("There is nothing to undo.")
    said = [record.message for record in records]
    assert said == ["There is nothing to undo.", "Cup cannot leave.", "There is nothing to undo."]
    records[-1].date -= timedelta(seconds=5)
    notifications.inform("There is nothing to undo.")
    assert len(records) == 4
