"""The documentation: every block of code runs, every link leads somewhere, the schema holds."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack import io
from napari_unpack.cli import app
from napari_unpack.io import interactive_page, report

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(p for p in DOCS.rglob("*.md") if p.parent.name != "decisions"),
]
FENCED = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"<!-- not run: (.+?) -->\n+```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MOST_NOT_RUN = 4
"""Blocks that need what is not here: a cluster, another program."""


def blocks(page: Path) -> list[tuple[str, str]]:
    """Return language and code of the blocks of a page that are to run, in their order."""
    text = page.read_text("utf-8")
    excused = {code for _, code in NOT_RUN.findall(text)}
    return [
        (language, code)
        for language, code in FENCED.findall(text)
        if language in ("python", "sh") and code not in excused
    ]


BEGINNINGS = (DOCS / "tutorials" / "index.md", DOCS / "how-to" / "index.md")
"""Pages that make the files that the others name."""


@pytest.fixture(scope="module")
def bag_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the files that the pages name, by the commands that the pages give for it."""
    folder = tmp_path_factory.mktemp("bag")
    for page in BEGINNINGS:
        run_blocks(page, folder)
    return folder


def run_blocks(page: Path, folder: Path) -> None:
    """Run the blocks of a page in a folder, as a reader does who copies one after the other."""
    names: dict[str, object] = {"__name__": "__page__"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        # Pictures of pages are small: that they are drawn at all is the claim.
        patch.setattr(interactive_page, "WINDOW", (144, 192))
        patch.setattr(report, "BAG", (60, 96))
        patch.setattr(report, "SIDE", 24)
        for k, (language, code) in enumerate(blocks(page)):
            if language == "python":
                exec(compile(code, f"{page.name}, block {k + 1}", "exec"), names)
            else:
                for line in code.splitlines():
                    run_line(line)


def run_line(line: str) -> None:
    """Run one line of a shell, or check what would take long or change this machine."""
    words = shlex.split(line, comments=True)
    if not words:
        return
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    if words[0] == "napari-unpack":
        done = CliRunner().invoke(app, words[1:])
        assert done.exit_code == 0, f"{line}\n{done.output}\n{done.exception!r}"
    elif words[0] == "make":
        # `make dist` and the tests themselves run these.
        assert unknown_targets(words[1:]) == []
    elif words[:2] == ["pip", "install"]:
        # `make dist` installs; here that each extra is one of ours.
        extras = re.findall(r"\[([\w,-]+)\]", line)
        asked = {name for extra in extras for name in extra.split(",")}
        assert asked <= project["optional-dependencies"].keys()
    elif words[0] == "mkdir":
        Path(words[1]).mkdir()
    else:
        # Tests among tests; another test looks whether they are there.
        assert words[0] in ("napari", "bash", ".venv/bin/python"), line


def unknown_targets(words: list[str]) -> list[str]:
    """Return which words after `make` are no targets of the Makefile."""
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    return [word for word in words if "=" not in word and word not in targets]


def test_make_in_sentences_names_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT)
    from benchmarks.rows import ORDER

    told = "".join(FENCED.sub("", page.read_text("utf-8")) for page in PAGES)
    commands = [shlex.split(command) for command in re.findall(r"`make ([^`]+)`", told)]
    assert len(commands) > 30
    assert [words for words in commands if unknown_targets(words)] == []
    rows = [word[5:].split() for words in commands for word in words if word.startswith("ROWS=")]
    asked = {row for some in rows for row in some}
    assert {row for row in asked if not any(row in name for name in ORDER)} == set()


@pytest.mark.parametrize(
    "page",
    # The beginnings have run for the files.
    [page for page in PAGES if page not in BEGINNINGS],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_every_block_of_code_runs(page: Path, bag_files: Path) -> None:
    run_blocks(page, bag_files)


def test_a_block_that_fails_would_be_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\nimport napari_unpack as nu\nnu.no_such_name\n```\n")
    with pytest.raises(AttributeError):
        run_blocks(page, tmp_path)
    page.write_text("```sh\nnapari-unpack order nothing.npz\n```\n")
    with pytest.raises(AssertionError, match="nothing"):
        run_blocks(page, tmp_path)
    page.write_text("```sh\nrm -r bag\n```\n")
    with pytest.raises(AssertionError):
        run_blocks(page, tmp_path)


def test_few_blocks_are_excused_and_each_says_why() -> None:
    excused = [why for page in PAGES for why, _ in NOT_RUN.findall(page.read_text("utf-8"))]
    assert len(excused) <= MOST_NOT_RUN
    assert all(len(why.split()) >= 2 for why in excused)


CHANGES = DOCS / "worked-changes.md"


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the repository with the five worked changes in it."""
    copy = tmp_path_factory.mktemp("changed")
    # With its compiled kernels, which are as new there.
    for folder in ("src", "tests", "tools"):
        shutil.copytree(ROOT / folder, copy / folder)
    shutil.copy(ROOT / "pyproject.toml", copy)
    changes = [
        code for language, code in FENCED.findall(CHANGES.read_text("utf-8")) if language == "diff"
    ]
    assert len(changes) == 5
    for change in changes:
        subprocess.run(["git", "apply", "-"], input=change, text=True, cwd=copy, check=True)
    return copy


def test_the_worked_changes_apply_and_the_tests_that_they_name_are_there(changed: Path) -> None:
    text = CHANGES.read_text("utf-8")
    named = {
        word for _, code in FENCED.findall(text) for word in re.findall(r"tests/\S+\.py", code)
    }
    assert len(named) > 6
    assert [name for name in named if not (changed / name).exists()] == []


def test_the_tests_of_worked_changes_pass(changed: Path) -> None:
    tests = ("appearance/test_transfer_function.py", "io/test_report.py", "io/test_mrc.py")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *(f"tests/{test}" for test in tests)],
        cwd=changed,
        # They need no plugin of pytest, of which napari's alone takes two seconds to load.
        env=os.environ
        | {"PYTHONPATH": str(changed / "src"), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def links(page: Path) -> Iterator[str]:
    """Return what a page links to or shows, outside of code."""
    text = FENCED.sub("", page.read_text("utf-8"))
    yield from re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", text))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as MkDocs and GitHub make them."""
    from markdown.extensions.toc import slugify

    titles = re.findall(r"^#+ (.+)$", FENCED.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {slugify(re.sub(r"[`*]", "", title), "-") for title in titles}


MADE = {"reference/command-line.md", "reference/keys.md", "reference/preferences.md"}
MADE |= {"contributing.md", "conventions.md", "changelog.md", "security.md", "decisions/index.md"}
MADE |= {"gallery/examples.md"}


@pytest.mark.parametrize(
    "page",
    [*PAGES, *sorted((DOCS / "decisions").glob("*.md"))],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_every_link_leads_to_a_file_that_there_is(page: Path) -> None:
    for link in links(page):
        if link.startswith(("https://", "http://", "mailto:")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        made = target.is_relative_to(DOCS) and target.relative_to(DOCS).as_posix() in MADE
        assert made or target.exists(), f"{link} of {page.name}"
        if anchor and not made:
            assert anchor in anchors(target), f"{link} of {page.name}"


def test_every_question_stands_in_the_index() -> None:
    folder = DOCS / "how-to"
    text = (folder / "index.md").read_text("utf-8")
    listed = dict(re.findall(r"^- \[(.+)\]\(([\w-]+\.md)\)$", text, re.MULTILINE))
    asked = {p.read_text("utf-8").splitlines()[0][2:]: p.name for p in folder.glob("*.md")}
    del asked["How-to"]
    assert listed == asked
    assert len(listed) >= 20
    assert [title for title in listed if not title.endswith("?")] == []


def test_every_picture_is_of_the_gallery() -> None:
    shown = {
        (page.parent / link).resolve()
        for page in PAGES
        for link in links(page)
        if link.endswith((".png", ".gif", ".svg")) and not link.startswith("http")
    }
    others = {path for path in shown if path.parent != DOCS / "gallery"}
    assert others <= {DOCS / "unpacking-steps.svg"}, "`make screenshots` makes pictures"


def test_pages_that_are_made_say_what_the_program_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "tools")
    from docs_pages import made_pages

    pages = made_pages()
    assert set(pages) == MADE
    command_line = pages["reference/command-line.md"]
    for command in ("simulate", "segment", "order", "movie", "surfaces", "batch", "open"):
        assert f"## `napari-unpack {command}`" in command_line
    assert "--turntable" in command_line
    assert "`segment`: Segment a volume into its objects; from Zarr to Zarr block" in command_line
    assert "..." not in command_line.split("## ")[0].replace("[ARGS]...", "")
    assert "| **N** | unpack next |" in pages["reference/keys.md"]
    assert "| **Keep unsaved work** | on |" in pages["reference/preferences.md"]
    assert "(0010-libraries-instead-of-our-own.md)" in pages["decisions/index.md"]


def test_the_page_of_examples_shows_each_with_its_source_and_a_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(ROOT / "tools")
    from docs_pages import made_pages

    page = made_pages()["gallery/examples.md"]
    scripts = sorted((ROOT / "examples").glob("*.py"))
    assert len(scripts) >= 6
    for script in scripts:
        _, told, code = script.read_text("utf-8").split('"""', 2)
        assert told.split("\n\n", 1)[1].strip() in page
        assert code.strip() in page
        assert f"`examples/{script.name}`" in page
    pictures = re.findall(r"!\[.+?\]\((example-[\w-]+\.png)\)", page)
    assert len(set(pictures)) == len(scripts)
    assert {p.name for p in (DOCS / "gallery").glob("example-*.png")} == set(pictures)
    # Their makers know every example.
    from example_pictures import SHOWN

    assert {f"{name}.py" for name in SHOWN} == {script.name for script in scripts}


def test_decisions_are_short_and_say_what_was_decided_first() -> None:
    for path in sorted((DOCS / "decisions").glob("0*.md")):
        lines = path.read_text("utf-8").splitlines()
        assert len(lines) <= 25, path.name
        assert lines[2].startswith("**Decided**"), path.name


def test_docstrings_of_the_package_refer_to_what_it_has() -> None:
    """Who reads `help(nu.name)` finds the parameters there, or in a name of the same page."""
    known = {*nu.__all__, *io.__all__}
    for name in nu.__all__:
        told = getattr(nu, name).__doc__ or ""
        others = set(re.findall(r"\b[Aa]s for `([\w.]+)`", told))
        assert others <= known, name


def test_the_reference_of_python_has_all_public_names_and_no_others() -> None:
    page = (DOCS / "reference" / "python.md").read_text("utf-8")
    shown = set(re.findall(r"^::: napari_unpack\.(.+)$", page, re.M))
    # The version has no page of its own.
    assert {name for name in shown if not name.startswith("io.")} == {*nu.__all__} - {"__version__"}


SCHEMA = json.loads((DOCS / "reference" / "session.schema.json").read_text("utf-8"))
FIXTURE_MODEL = ROOT / "tests" / "io" / "fixtures" / "oracle.npz"
SAVED = sorted((ROOT / "tests" / "io" / "fixtures").glob("*.unpack"))


def told(path: Path) -> dict[str, object]:
    """Return the session.json of a saved session."""
    with zipfile.ZipFile(path) as archive:
        found: dict[str, object] = json.loads(archive.read("session.json"))
        return found


@pytest.mark.parametrize("path", SAVED, ids=lambda path: path.stem)
def test_sessions_of_older_versions_keep_to_the_schema(path: Path) -> None:
    jsonschema.validate(told(path), SCHEMA)


def test_a_session_of_today_keeps_to_the_schema(tmp_path: Path) -> None:
    labels = np.zeros((12, 12, 20), np.uint16)
    labels[2:6, 2:8, 2:8], labels[6:10, 2:8, 2:8], labels[2:9, 2:8, 10:16] = 1, 2, 3
    session = nu.Session(np.where(labels > 0, 900, 0), labels)
    session.unpack(1)
    session.annotations.set_color(3, (1.0, 0.0, 0.0, 1.0))
    session.annotations.set_note(3, "seen")
    nu.save_session(session, tmp_path / "today.unpack")
    record = told(tmp_path / "today.unpack")
    jsonschema.validate(record, SCHEMA)
    session.use_oracle(nu.Oracle.load(FIXTURE_MODEL), dict.fromkeys(session.ids, 0.5))
    nu.save_session(session, tmp_path / "own.unpack")
    own = told(tmp_path / "own.unpack")
    jsonschema.validate(own, SCHEMA)
    assert own.keys() - record.keys() == {"model"}
    session.use_oracle(None, {1: 0.5})
    nu.save_session(session, tmp_path / "built-in.unpack")
    jsonschema.validate(told(tmp_path / "built-in.unpack"), SCHEMA)
    record["session"]["situation"]["hues"]["1"] = 2  # type: ignore[index]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(record, SCHEMA)


def test_python_runs_these_tests_with_the_package_of_this_repository() -> None:
    assert Path(sys.modules["napari_unpack"].__file__ or "").is_relative_to(ROOT)
