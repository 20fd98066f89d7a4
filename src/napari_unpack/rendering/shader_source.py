"""Reads GLSL files, joins their includes, and finds the way back from a driver's line numbers.

Only text is handled here. `#include "lib/x.glsl"` puts a file in once, where it is first asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources

INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
STRIDE = 100_000
"""Line n of the i-th file is numbered i * STRIDE + n: drivers and vispy keep numbers, not names."""


@dataclass(frozen=True)
class ShaderSource:
    """A whole shader: GLSL without includes, and the files it came from, by number."""

    code: str
    files: tuple[str, ...]

    def explain(self, log: str) -> str:
        """Return a driver's log with our file names and lines in place of its numbers."""

        def named(match: re.Match[str]) -> str:
            file, line = divmod(int(match.group()), STRIDE)
            return f"{self.files[file - 1]}:{line}" if file <= len(self.files) else match.group()

        return re.sub(rf"\b[1-9]\d{{{len(str(STRIDE)) - 1},}}\b", named, log)


def read(path: str) -> str:
    """Return the text of one file under shaders/; raise `FileNotFoundError` if it is missing."""
    return resources.files("napari_unpack.shaders").joinpath(path).read_text(encoding="utf-8")


def load(
    path: str,
    defines: Mapping[str, object] | None = None,
    version: str | None = None,
    read: Callable[[str], str] = read,
) -> ShaderSource:
    """Join a shader under shaders/ with what it includes, version and macros first.

    Raises
    ------
    ValueError
        If files include each other in a circle.
    """
    files: list[str] = [path]

    def expand(name: str, above: tuple[str, ...]) -> list[str]:
        base = (files.index(name) + 1) * STRIDE
        # GLSL 1.20, section 3.3: the line after `#line n` is n + 1.
        lines = [f"#line {base}"]
        for number, line in enumerate(read(name).splitlines(), start=1):
            match = INCLUDE.match(line)
            if match is None:
                lines.append(line)
                continue
            wanted = match.group(1)
            if wanted in (*above, name):
                circle = " -> ".join([*above, name, wanted])
                raise ValueError(f"shader files include each other in a circle: {circle}")
            if wanted not in files:
                files.append(wanted)
                lines += expand(wanted, (*above, name))
            lines.append(f"#line {base + number}")
        return lines

    head = [f"#version {version}"] if version else []
    head += [f"#define {key} {value}" for key, value in (defines or {}).items()]
    return ShaderSource("\n".join([*head, *expand(path, ())]) + "\n", tuple(files))
