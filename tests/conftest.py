"""What all tests share: compiled kernels, as new as their sources, kept by one worker at a time."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

FRESH_KERNELS = Path(__file__).parents[1] / "tools" / "fresh_kernels.py"


def pytest_configure(config: pytest.Config) -> None:
    """Let no test run old compiled code; give each worker its own screen and no idle threads."""
    if not hasattr(config, "workerinput"):
        subprocess.run([sys.executable, FRESH_KERNELS], check=True)
        # Workers inherit it. Each product of matrices wakes a thread on every core, which then
        # spins for the next: beside other tests that took a seventh of the processor's time.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    elif os.environ.get("UNPACK_VIRTUAL_SCREEN"):
        # On one screen they would take the focus from each other.
        from screens import Screen

        config.add_cleanup(Screen().close)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest: another worker does the rest meanwhile, and none is waited for."""
    items.sort(key=lambda item: item.path.name not in ("test_soak.py", "test_backpack.py"))


def pytest_collection_finish() -> None:
    """Keep the garbage collector off modules and tests, which stay: that is a tenth of its time."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Note which code the kernels of this run were made from."""
    if not hasattr(config, "workerinput"):
        subprocess.run([sys.executable, FRESH_KERNELS], check=True)


@pytest.fixture(scope="session", autouse=True)
def kernels_kept_by_one_process_at_a_time() -> None:
    """Let the workers of one run, and those that batches start, take turns at numba's cache."""
    from napari_unpack.batches.kernel_cache import keep_kernels_one_at_a_time

    keep_kernels_one_at_a_time()
