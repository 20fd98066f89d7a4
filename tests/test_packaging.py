"""The wheel, the sdist and the editable install all carry shaders and manifest."""

import json
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist from a clean copy of what git tracks, and the wheel built from that sdist."""
    source = tmp_path_factory.mktemp("source")
    tracked = _run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", cwd=ROOT)
    for name in filter(None, tracked.split("\0")):
        origin, copy = ROOT / name, source / name
        if not origin.exists():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        if origin.is_symlink():
            copy.symlink_to(origin.readlink())
        else:
            copy.write_bytes(origin.read_bytes())
    out = tmp_path_factory.mktemp("dist")
    _run(sys.executable, "-m", "build", "--no-isolation", "-o", out, ".", cwd=source)
    return out


def _names_in_wheel(built: Path) -> list[str]:
    (wheel,) = built.glob("*.whl")
    return zipfile.ZipFile(wheel).namelist()


def test_the_wheel_has_every_module_and_every_shader(built: Path) -> None:
    names = set(_names_in_wheel(built))
    modules = {
        "napari_unpack/" + p.relative_to(ROOT / "src/napari_unpack").as_posix()
        for p in (ROOT / "src/napari_unpack").rglob("*.py*")
        if p.suffix in (".py", ".pyi")
    }
    shaders = {
        "napari_unpack/shaders/" + p.relative_to(ROOT / "shaders").as_posix()
        for p in (ROOT / "shaders").rglob("*")
        if p.is_file() and "__pycache__" not in p.parts
    }
    assert modules | shaders | {"napari_unpack/napari.yaml", "napari_unpack/py.typed"} <= names


def test_the_wheel_has_at_most_5_mb(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.stat().st_size <= 5_000_000


def test_the_sdist_has_the_manifest_once_and_the_shaders(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = [name.split("/", 1)[1] for name in archive.getnames() if "/" in name]
    assert "src/napari_unpack/napari.yaml" in names
    assert "napari.yaml" not in names
    assert any(name.startswith("shaders/passes/") for name in names)


def test_a_clean_environment_with_the_wheel_lists_the_plugin(built: Path, tmp_path: Path) -> None:
    clean = tmp_path / "clean"
    venv.create(clean, with_pip=False)
    python = clean / "bin" / "python"
    (wheel,) = built.glob("*.whl")
    (site,) = clean.glob("lib/python*/site-packages")
    zipfile.ZipFile(wheel).extractall(site)
    # Dependencies are read from this environment by path, whose own .pth files (among them the
    # editable install's) are not followed, so napari_unpack can only be the wheel's.
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")

    listing = json.loads(_run(python, "-m", "npe2", "list", "--format", "json", cwd=tmp_path))
    assert any(plugin["name"] == "napari-unpack" for plugin in listing)

    found = _run(
        python,
        "-c",
        "import importlib.resources as r, napari_unpack as n;"
        "print(n.__file__); print(sorted(p.name for p in "
        "(r.files('napari_unpack.shaders') / 'passes').iterdir()))",
        cwd=tmp_path,
    )
    assert str(site) in found
    assert "tinted_volume" in found


def test_the_editable_install_finds_shaders_and_manifest() -> None:
    import importlib.resources

    assert (importlib.resources.files("napari_unpack") / "napari.yaml").is_file()
    assert (importlib.resources.files("napari_unpack.shaders") / "passes").is_dir()


@pytest.mark.parametrize("module", ["napari_unpack", "napari_unpack.batches.run"])
def test_importing_the_package_or_what_runs_a_batch_loads_nothing_heavy(
    module: str, tmp_path: Path
) -> None:
    loaded = _run(
        sys.executable,
        "-c",
        f"import sys, {module}; print([m for m in ('numba', 'scipy', 'napari', 'vispy', "
        "'skimage', 'pandas', 'networkx') if m in sys.modules])",
        cwd=tmp_path,
    )
    assert loaded.strip() == "[]"
