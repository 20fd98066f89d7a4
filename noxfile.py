"""The tests in fresh environments, as the workflows run them: `nox --list`.

`make test` runs them with the hashed versions. Here packages are the newest that `pyproject.toml`
allows, the lowest, or what napari and numpy are about to release.
"""

import sys

import nox

PYTHONS = ["3.11", "3.12", "3.13", "3.14"]
LINUX = sys.platform == "linux"
VIEWER_TESTS = ["tests/layers", "tests/viewer", "tests/widgets"]

nox.options.default_venv_backend = "uv"
nox.options.sessions = ["tests"]


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """Run all tests with the newest packages; `-- --cov` measures what they reach."""
    session.install("-e", ".", "--group", "dev", "pytest-cov")
    _test(session)


@nox.session(python="3.11")
def lowest(session: nox.Session) -> None:
    """Run all tests with the lowest packages that pyproject.toml allows."""
    session.install("-e", ".", "--group", "dev", "pytest-cov", "--resolution", "lowest-direct")
    _test(session)


@nox.session(python="3.13")
def prereleases(session: nox.Session) -> None:
    """Run all tests with what napari and numpy are about to release."""
    session.install("-e", ".", "--group", "dev", "pytest-cov")
    session.install("--upgrade", "--prerelease", "if-necessary-or-explicit", "napari>=0.9.0a0")
    session.install("--upgrade", "--prerelease", "if-necessary-or-explicit", "numpy>=1.26.0rc1")
    _test(session)


def _test(session: nox.Session) -> None:
    workers = ("-n", "2", "--dist", "worksteal", *session.posargs)
    plain = [f"--ignore={folder}" for folder in VIEWER_TESTS]
    # As make test: shaders without a screen, the plugin on one. Other systems have a screen.
    no_screen = {"PYOPENGL_PLATFORM": "egl", "EGL_PLATFORM": "surfaceless"} if LINUX else {}
    on_screen = ("bash", "tools/on-a-screen.sh") if LINUX else ()
    session.run("python", "-m", "pytest", *workers, "tests", *plain, env=no_screen)
    if "--cov" in session.posargs:
        workers = (*workers, "--cov-append")
    command = (*on_screen, "python", "-m", "pytest", *workers, *VIEWER_TESTS)
    session.run(*command, env={"VIRTUAL_SCREEN": "1"}, external=True)
