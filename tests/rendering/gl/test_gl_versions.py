"""Pictures under other versions of OpenGL, which Mesa pretends to be."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from napari_unpack import rendering
from napari_unpack.rendering.gl import formats, offscreen

CHILD = """
import sys
import numpy as np
from napari_unpack import rendering
from napari_unpack.rendering.gl import offscreen
found = dict(np.load(sys.argv[1]))
picture = rendering.render(found["volume"], found["labels"], size=(48, 64), backend="gl")
ids = rendering.object_id_layers(found["labels"], size=(48, 64), backend="gl")
ratios = rendering.occlusion_ratios(found["labels"], size=(48, 64), backend="gl")
np.savez(sys.argv[2], picture=picture, ids=ids, ratios=list(ratios.values()))
print(offscreen.context().version)
"""


def _bag() -> tuple[np.ndarray, np.ndarray]:
    labels = np.zeros((12, 14, 16), np.uint16)
    labels[2:8, 2:9, 2:8], labels[4:10, 5:12, 9:14] = 1, 2
    return (labels * 400 + np.indices(labels.shape).sum(0) * 9).astype(np.uint16), labels


def _drawn(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    volume, labels = _bag()
    np.savez(folder / "bag.npz", volume=volume, labels=labels)
    return subprocess.run(
        [sys.executable, "-c", CHILD, folder / "bag.npz", folder / "out.npz"],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    ("version", "language"), [("2.1", "120"), ("3.0", "130"), ("3.3COMPAT", "330"), ("4.5", "450")]
)
def test_pictures_are_the_processors_under_every_version(
    version: str, language: str, tmp_path: Path, offscreen_context
) -> None:
    child = _drawn(tmp_path, MESA_GL_VERSION_OVERRIDE=version, MESA_GLSL_VERSION_OVERRIDE=language)
    assert child.returncode == 0, child.stderr
    if not child.stdout.startswith(version[:3]):
        pytest.skip(f"this driver cannot pretend to be {version}: {child.stdout}")
    volume, labels = _bag()
    seen, cpu = np.load(tmp_path / "out.npz"), {"size": (48, 64), "backend": "cpu"}
    np.testing.assert_allclose(seen["picture"], rendering.render(volume, labels, **cpu), atol=1e-3)
    np.testing.assert_array_equal(seen["ids"], rendering.object_id_layers(labels, **cpu))
    wanted = rendering.occlusion_ratios(labels, **cpu)
    np.testing.assert_allclose(seen["ratios"], list(wanted.values()))


def test_without_float_textures_there_is_no_offscreen_gl(
    monkeypatch: pytest.MonkeyPatch, offscreen_context
) -> None:
    monkeypatch.setattr(formats, "lacking", lambda: formats.FLOATS)
    with pytest.raises(RuntimeError, match=r"the driver \(.*\) has no float textures"):
        offscreen.Offscreen()
