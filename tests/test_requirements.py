"""What the two commands install: pinned and hashed as pyproject.toml asks, under known licences."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
GROUPS = PROJECT["dependency-groups"]
LICENCES = ROOT / "tools" / "licences.py"

ASKED = {
    "dev": [*PROJECT["project"]["dependencies"], *GROUPS["dev"]],
    "bench": GROUPS["bench"],
    "tools": GROUPS["tools"],
    "docs": GROUPS["docs"],
    "web": GROUPS["web"],
}


def entries(name: str) -> list[str]:
    """Return the requirements of a hashed file, each with its hashes on one line."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text("utf-8").replace("\\\n", "")
    return [line for line in text.splitlines() if not line.startswith("#")]


def pinned(name: str) -> dict[str, str]:
    """Return the version of each package that a hashed file installs on this machine."""
    found = [Requirement(entry.split(" --hash")[0]) for entry in entries(name)]
    here = [one for one in found if one.marker is None or one.marker.evaluate()]
    return {canonicalize_name(one.name): str(one.specifier).removeprefix("==") for one in here}


@pytest.mark.parametrize("name", ASKED)
def test_every_entry_has_one_version_and_hashes_and_names_no_place(name: str) -> None:
    entry = r"[\w.-]+==[\w.]+( ; [^;]+?)?( +--hash=sha256:[0-9a-f]{64})+"
    assert [line for line in entries(name) if not re.fullmatch(entry, line)] == []


@pytest.mark.parametrize("name", ASKED)
def test_the_hashed_file_has_what_pyproject_asks_for_and_all_that_this_needs(name: str) -> None:
    versions = pinned(name)
    left, seen = [Requirement(text) for text in ASKED[name]], set()
    while left:
        wanted = left.pop()
        version = versions[canonicalize_name(wanted.name)]
        assert wanted.specifier.contains(version, prereleases=True), f"{wanted}, not {version}"
        if str(wanted) in seen:
            continue
        seen.add(str(wanted))
        try:
            needs = requires(wanted.name) or []
        except PackageNotFoundError:  # benchmarks and tools are not always installed
            continue
        left += [
            need
            for need in map(Requirement, needs)
            if need.marker is None
            or any(need.marker.evaluate({"extra": extra}) for extra in ["", *wanted.extras])
        ]


def test_the_files_agree_with_each_other() -> None:
    for other in ("bench", "tools", "docs", "web"):
        both = pinned(other).items()
        different = {n: v for n, v in both if pinned("dev").get(n, v) != v}
        assert different == {}


def test_all_that_is_installed_is_permissive_or_lgpl_or_has_its_reason() -> None:
    done = subprocess.run([sys.executable, LICENCES], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "numpy" in done.stdout


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("MIT", True),
        ("LGPL-3.0-or-later", True),
        ("GNU Lesser General Public License v3 (LGPLv3)", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("GPL-2.0-only OR MIT", True),
        ("ISC License (ISCL)", True),
        ("GPL-3.0-only", False),
        ("GPL-3.0-only AND (MIT OR BSD-2-Clause)", False),
        ("MIT AND (AGPL-3.0-only OR SSPL-1.0)", False),
        ("GNU General Public License v3 (GPLv3)", False),
        ("not named", False),
    ],
)
def test_of_two_licences_one_may_be_chosen_but_all_parts_must_be_allowed(
    monkeypatch: pytest.MonkeyPatch, expression: str, expected: bool
) -> None:
    monkeypatch.syspath_prepend(LICENCES.parent)
    from licences import allowed, faults

    assert allowed(expression) is expected
    assert bool(list(faults({"package": expression}))) is not expected


def commands(target: str) -> list[str]:
    """Return what `make` would run for a target, were nothing there yet."""
    done = subprocess.run(
        ("make", "-nB", target), cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_make_installs_by_hash_alone_and_then_this_package_without_dependencies() -> None:
    for target in ("demo", "test"):
        installs = [line for line in commands(target) if " pip install " in line]
        assert len(installs) == 2
        assert installs[0].endswith("--require-hashes -r requirements/dev.txt")
        assert installs[1].endswith("--no-deps --no-build-isolation -e .")


def test_a_workflow_asks_for_advisories_on_all_files_every_week() -> None:
    (asked,) = [line for line in commands("audit") if "pip-audit" in line]
    assert {path.name for path in (ROOT / "requirements").glob("*.txt")} == set(
        re.findall(r"-r requirements/(\S+)", asked)
    )
    workflow = (ROOT / ".github" / "workflows" / "audit.yml").read_text("utf-8")
    (time,) = re.findall(r'cron: "(.*)"', workflow)
    minute, hour, day, month, weekday = time.split()
    assert (day, month) == ("*", "*")
    assert all(part.isdigit() for part in (minute, hour, weekday))
    runs = re.findall(r"^ +run: (.*)$", workflow, re.MULTILINE)
    assert runs == ["make setup", "make audit", "make licences"]
