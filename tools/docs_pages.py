"""Pages of the documentation site that are made from the code: a hook of MkDocs.

The command line, the keys and the preferences are read from what runs; files of the repository's
root get a page with links that hold on the site.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
OF_THE_ROOT = {
    "contributing.md": "CONTRIBUTING.md",
    "conventions.md": "CONVENTIONS.md",
    "changelog.md": "CHANGELOG.md",
    "security.md": "SECURITY.md",
}
"""Page of the site, and the file in the repository's root that it shows."""


ELSEWHERE = re.compile(r"<(script|link|img|iframe|source)\b[^>]*\b(src|href)=.?(https?:)?//[^>]*>")


def on_config(config: Any) -> Any:
    """Put the questions of docs/how-to into the menu, in the order of their index."""
    index = (DOCS / "how-to" / "index.md").read_text("utf-8")
    pages = [f"how-to/{name}" for name in re.findall(r"\]\(([\w-]+\.md)\)", index)]
    for entry in config["nav"]:
        if entry.get("How-to") == "HOW_TO":
            entry["How-to"] = ["how-to/index.md", *pages]
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Begin a list after a paragraph with an empty line, which Python-Markdown asks for."""
    return re.sub(r"(?m)^([^\s\-|>#`].*)\n(?=(?:- |1\. ))", r"\1\n\n", markdown)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made."""
    from mkdocs.structure.files import File

    for name, text in made_pages().items():
        files.append(File.generated(config, name, content=text))
    return files


def on_post_build(config: Any) -> None:
    """Refuse a site of which a page loads anything from elsewhere."""
    from mkdocs.exceptions import PluginError

    for path in Path(config["site_dir"]).rglob("*.html"):
        found = ELSEWHERE.search(path.read_text("utf-8"))
        if found:
            raise PluginError(f"{path.name} loads from elsewhere: {found[0]}")


def made_pages() -> dict[str, str]:
    """Return the text of each page that is made, by its path on the site."""
    pages = {page: of_root(name) for page, name in OF_THE_ROOT.items()}
    pages["reference/command-line.md"] = command_line()
    pages["reference/keys.md"] = keys()
    pages["reference/preferences.md"] = preferences()
    pages["decisions/index.md"] = decisions()
    pages["gallery/examples.md"] = examples()
    return pages


def of_root(name: str) -> str:
    """Return a file of the root with its links as the site has them."""
    text = (ROOT / name).read_text("utf-8").replace("](docs/", "](")
    for page, file in OF_THE_ROOT.items():
        text = text.replace(f"]({file}", f"]({page}")
    return text


def command_line() -> str:
    """Return what `--help` says of every command, as typer writes it for pages."""
    import typer
    from typer.cli import get_docs_for_click

    from napari_unpack.cli import app

    command = typer.main.get_command(app)
    for one in command.commands.values():  # type: ignore[attr-defined]
        # Else typer cuts it off after some words.
        one.short_help = one.help.split("\n\n")[0]
    told = get_docs_for_click(obj=command, ctx=typer.Context(command), name="napari-unpack")
    # Blocks that show how a command is called are no blocks to run.
    told = told.replace("# `napari-unpack`", "# Command line", 1)
    return told.replace("```console\n$ ", "```text\n")


def keys() -> str:
    """Return the keys and what the mouse does, as the panel's help says it."""
    from napari_unpack.widgets.shortcuts import IN_SLICES, KEYS, MOUSE

    lines = [
        "# Keys and mouse",
        "",
        "The keys act while a session is open and the keyboard is in the 3D view or on a button "
        "of the panel. The panel lists them too, under *Keys and mouse*.",
        "",
        IN_SLICES,
        "",
    ]
    for title, rows in (("Key", KEYS), ("Mouse", MOUSE)):
        lines += [f"| {title} | |", "|---|---|"]
        lines += [f"| **{how}** | {what} |" for how, what in rows] + [""]
    return "\n".join(lines)


def preferences() -> str:
    """Return the preferences of the manifest."""
    manifest = yaml.safe_load((ROOT / "src/napari_unpack/napari.yaml").read_text("utf-8"))
    lines = ["# Preferences", "", "In napari: *File > Preferences > Virtual Unpacking*.", ""]
    for page in manifest["contributions"]["configurations"].values():
        lines += [f"## {page['title']}", "", "| | default | |", "|---|---|---|"]
        for told in page["properties"].values():
            choices = f" One of: {', '.join(told['enum'])}." if "enum" in told else ""
            default = {True: "on", False: "off"}.get(told["default"], told["default"])
            lines.append(f"| **{told['title']}** | {default} | {told['description']}{choices} |")
        lines.append("")
    return "\n".join(lines)


def decisions() -> str:
    """Return the list of decisions, each by its title."""
    lines = ["# Decisions", "", "What was decided, why, and by which figures.", ""]
    for path in sorted((DOCS / "decisions").glob("0*.md")):
        title = path.read_text("utf-8").splitlines()[0].removeprefix("# ")
        # A list's own numbers would hide those of the decisions.
        lines.append(f"- [{title}]({path.name})")
    return "\n".join([*lines, ""])


def examples() -> str:
    """Return every example with what it is for, its picture and its source."""
    listed, folder = (ROOT / "examples" / "README.md").read_text("utf-8"), ROOT / "examples"
    head = listed.split("\n\n- ")[0]
    lines = [head, "", "`make screenshots` runs each of them for its picture.", ""]
    for name in re.findall(r"(?m)^- `(\w+)\.py`", listed):
        source = (folder / f"{name}.py").read_text("utf-8")
        told = ast.get_docstring(ast.parse(source)) or ""
        title, about = told.split("\n\n", 1)
        code = source.split('"""\n', 1)[1].strip()
        picture = f"![{title}](example-{name.replace('_', '-')}.png)"
        lines += [f"## {title.rstrip('.')}", "", about, "", picture, ""]
        lines += [f"`examples/{name}.py`", "", "```python", code, "```", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(made_pages()[sys.argv[1]])
