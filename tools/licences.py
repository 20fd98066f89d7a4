"""List name, version and licence of all that is installed; refuse what is not ours to use.

`python tools/licences.py`: permissive licences and the LGPL pass; of anything else `EXCEPTIONS`
says why it is there. Exits with 1 where a licence is neither, or an exception is not needed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from importlib.metadata import Distribution, distributions

PERMISSIVE_OR_LGPL = re.compile(
    r"\b(0?BSD|MIT|Apache|ISC|PSF|Python Software Foundation|Zlib|CC0|HPND|Unlicense|"
    r"LGPL|Lesser General Public)\b",
    re.IGNORECASE,
)
COPYLEFT = re.compile(r"\b(A?GPL|(?<!Lesser )General Public)\b", re.IGNORECASE)
BY_FILE = "copyleft of its own files only, less than the LGPL asks; used unmodified"
EXCEPTIONS = {
    "certifi": ("Mozilla Public License 2.0 (MPL 2.0)", BY_FILE),
    "dcm2niix": (
        "The following files are from different authors and have their own licenses",
        "the text that follows is the BSD licence, of parts the MIT licence or public domain; "
        "run by tests alone",
    ),
    "docutils": (
        "BSD License AND GNU General Public License (GPL)",
        "the GPL is of one file, its mode for Emacs; a tool of `make dist` alone",
    ),
    "hypothesis": ("MPL-2.0", BY_FILE + ", by tests alone"),
    "pathspec": ("Mozilla Public License 2.0 (MPL 2.0)", BY_FILE + ", by mypy alone"),
    "tqdm": ("MPL-2.0 AND MIT", BY_FILE),
    "pyqt6": (
        "GPL-3.0-only",
        "napari's own default, in the environment of the two commands alone; the package speaks "
        "qtpy, and neither needs PyQt nor ships it; PySide6 (LGPL) serves as well",
    ),
}
"""What passes all the same, by name: the licence that it has, and why it may be there."""
BESIDE = {
    "imageio-ffmpeg": "its wheel brings the program ffmpeg (GPL), run as a process of its own",
}
"""What the metadata does not say."""


def licence(distribution: Distribution) -> str:
    """Return the licence that a distribution names: SPDX, its classifiers, or its first words."""
    about = distribution.metadata
    classifiers = [
        name.rsplit("::", 1)[1].strip()
        for name in about.get_all("Classifier") or []
        if name.startswith("License :: OSI Approved ::")
    ]
    words = (about.get("License") or "").strip() or "not named"
    return about.get("License-Expression") or " AND ".join(classifiers) or words.splitlines()[0]


def allowed(expression: str) -> bool:
    """Return whether one choice of an SPDX expression is permissive or LGPL in all its parts."""
    while (inner := re.search(r"\(([^()]*)\)", expression)) is not None:
        known = "MIT" if allowed(inner[1]) else "refused"
        expression = expression[: inner.start()] + known + expression[inner.end() :]
    return any(
        all(
            PERMISSIVE_OR_LGPL.search(part) and not COPYLEFT.search(part)
            for part in re.split(r"\bAND\b", choice)
        )
        for choice in re.split(r"\bOR\b", expression)
    )


def faults(licences: dict[str, str]) -> Iterable[str]:
    """Yield a sentence for each licence that is neither allowed nor an exception."""
    for name, found in licences.items():
        expected, _ = EXCEPTIONS.get(name.lower(), (None, ""))
        if not allowed(found) and found != expected:
            yield f"{name}: {found!r} is neither permissive nor LGPL; choose another package"
        if allowed(found) and expected is not None:
            yield f"{name}: {found!r} needs no exception any more; remove it from the table"


def main() -> int:
    """Print the list and what is wrong with it; return the exit status."""
    found = {d.metadata["Name"]: (d.version, licence(d)) for d in distributions()}
    for name, (version, text) in sorted(found.items(), key=lambda item: item[0].lower()):
        _, reason = EXCEPTIONS.get(name.lower(), ("", BESIDE.get(name.lower(), "")))
        print(f"{name} {version}: {text}{f' ({reason})' if reason else ''}")
    wrong = list(faults({name: text for name, (_, text) in found.items()}))
    print(*wrong, f"{len(found)} packages, {len(wrong)} refused", sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
