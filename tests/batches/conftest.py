"""Three tiny bags with labels, one without, one broken file, and a real cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from dask_pair import Pair, make_bag

from napari_unpack.batches.cluster import cluster_client

# The processes of every cluster read it as they start. A worker that waits looks a hundred times a
# second at what it does, and each process fifty times at its own clock: the pair took a seventh of
# a core until the last of all tests.
for name, value in {"WORKER__PROFILE__ENABLED": "False", "ADMIN__TICK__INTERVAL": "500ms"}.items():
    os.environ.setdefault(f"DASK_DISTRIBUTED__{name}", value)


@pytest.fixture(scope="session")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three bags, one of them without labels, and a broken file."""
    folder = tmp_path_factory.mktemp("bags")
    make_bag(folder / "a.npz", 0)
    make_bag(folder / "b.npz", 1, labelled=False)
    make_bag(folder / "c.npz", 2)
    (folder / "broken.npz").write_bytes(b"PK not an archive")
    return folder


@pytest.fixture(scope="session")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    """A scheduler with two workers."""
    started = Pair(tmp_path_factory.mktemp("dask"))
    started.worker()
    started.worker()
    yield started
    started.close()


@pytest.fixture(scope="session")
def client(pair: Pair) -> Iterator[Any]:
    """A client of the pair, with both workers."""
    with cluster_client([], scheduler=str(pair.file)) as found:
        found.wait_for_workers(2, timeout=60)
        yield found
