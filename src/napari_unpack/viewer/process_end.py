"""The process ends although a worker is still in a library's code that nobody can call off."""

from __future__ import annotations

import os
import sys
import threading
from time import monotonic, sleep

# The name that threads of this package begin with.
OURS = "unpack"

# Most work stops at its next report, within this; the window has closed by then.
GRACE_SECONDS = 0.5

LOOK_SECONDS = 0.05


def end_despite_workers() -> None:
    """Let the process end soon after its main thread, where only our threads hold it up.

    Notes
    -----
    Python waits for its threads: for a step of a segmentation half a minute, for a kernel that is
    being compiled longer. What they work on is of no use any more, and files are written whole or
    not at all. Threads of others are waited for as ever.
    """
    ended = threading.Event()
    # Before Python begins to wait; its public `atexit` comes only after.
    register = getattr(threading, "_register_atexit", None)
    if register is not None:
        register(ended.set)
        threading.Thread(target=_watch, args=(ended,), name=f"{OURS}-end", daemon=True).start()


def _watch(main_ended: threading.Event) -> None:
    main_ended.wait()
    since = monotonic()
    while True:
        sleep(LOOK_SECONDS)
        main = threading.main_thread()
        waited_for = [t for t in threading.enumerate() if t is not main and not t.daemon]
        if not waited_for:
            return
        only_ours = all(thread.name.startswith(OURS) for thread in waited_for)
        if only_ours and monotonic() - since > GRACE_SECONDS:
            sys.stdout.flush()
            sys.stderr.flush()
            # Without the end that Python makes: it would not come while they run.
            os._exit(0)
