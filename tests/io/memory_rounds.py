"""Memory over rounds of opening, unpacking and saving a session: nothing may be kept.

    python tests/io/memory_rounds.py 1000

Counted is what is allocated, in blocks of Python's and bytes of the C library's, NumPy's arrays
included. What the process holds (resident memory) is printed beside it: it grows for some twenty
rounds and then stays. glibc takes arrays from its stock, and leaves holes there, once it has seen
one as large freed; with MALLOC_MMAP_THRESHOLD_=1048576 it does not, and stays flat from the start.
"""

from __future__ import annotations

import ctypes
import gc
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from napari_unpack import Session
from napari_unpack.io import open_session, save_session

SHAPE, CELL = (32, 32, 32), 16
# Caches fill, and modules are imported, in the first rounds.
WARM_UP = 4
# Less than one such bag. Of Python's small blocks some five a round stay, over a thousand rounds:
# whose they are is not known.
MOST_BYTES, MOST_BLOCKS = 150_000, 10_000
# Python's table of the names in a program (`sys.intern`) takes 1.92 MB, and as much more the moment
# it is full: once in a thousand rounds. With room for so many names it does not fill up.
NAMES = 300_000


class _MallocFacts(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


@dataclass(frozen=True)
class Held:
    """What a process has allocated.

    Parameters
    ----------
    blocks : int
        Python's.
    allocated : int
        Bytes of the C library; of all that is resident where that does not tell.
    resident : int
        Bytes that the process holds, free ones included.
    """

    blocks: int
    allocated: int
    resident: int

    @staticmethod
    def now() -> Held:
        """Look, after what nobody knows any more has been thrown away."""
        gc.collect()
        resident = int(psutil.Process().memory_info().rss)
        facts = getattr(ctypes.CDLL(None), "mallinfo2", None)
        if facts is None:
            return Held(sys.getallocatedblocks(), resident, resident)
        facts.restype = _MallocFacts
        found = facts()
        return Held(sys.getallocatedblocks(), found.uordblks + found.hblkhd, resident)


def packed_session() -> Session:
    """Return a bag of eight boxes, 0.2 MB."""
    cells = [np.arange(n) // CELL for n in SHAPE]
    inside = [np.isin(np.arange(n) % CELL, range(2, CELL - 2)) for n in SHAPE]
    ids = 1 + (cells[0][:, None, None] * 2 + cells[1][:, None]) * 2 + cells[2]
    mask = inside[0][:, None, None] & inside[1][:, None] & inside[2]
    labels = np.where(mask, ids, 0).astype(np.int32)
    volume = np.where(mask, 900 + 40 * ids, 5).astype(np.uint16)
    return Session(volume, labels, (1.0, 1.0, 1.0))


def rounds(count: int, folder: Path) -> Iterator[Held]:
    """Yield what is held after each round.

    Parameters
    ----------
    count : int
    folder : Path
        Where the session is saved.
    """
    # All at once: one that is dropped gives its place back.
    names = [sys.intern(f"name {n}") for n in range(NAMES)]
    del names
    # Not the file that is saved: a session's log goes on in it, round after round.
    packed, file = folder / "packed.unpack", folder / "bag.unpack"
    save_session(packed_session(), packed)
    # What was there before is no garbage of the rounds; each look would go through all of it.
    gc.freeze()
    for _ in range(count):
        session = open_session(packed)
        session.unpack(1)
        save_session(session, file)
        del session
        yield Held.now()


def growth(held: list[Held]) -> tuple[int, int]:
    """Return the blocks and bytes by which more is allocated at the end than after warming up."""
    warm = held[WARM_UP:]
    # The least of a few: what another thread is just doing is no growth.
    first, last = warm[: len(warm) // 3], warm[-(len(warm) // 3) :]
    return (
        min(h.blocks for h in last) - min(h.blocks for h in first),
        min(h.allocated for h in last) - min(h.allocated for h in first),
    )


def main() -> int:
    """Print what rounds keep; return 1 where that is anything."""
    count, held = int(sys.argv[1]), []
    with tempfile.TemporaryDirectory() as folder:
        for n, now in enumerate(rounds(count, Path(folder)), 1):
            held.append(now)
            if n % max(1, count // 10) == 0:
                resident, allocated = now.resident / 1e6, now.allocated / 1e6
                print(
                    f"[memory] round {n}: {allocated:.1f} MB and {now.blocks} blocks allocated, "
                    f"{resident:.0f} MB resident",
                    flush=True,
                )
    blocks, size = growth(held)
    print(f"[memory] {count} rounds keep {blocks} blocks and {size} bytes")
    return int(blocks > MOST_BLOCKS or size > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
