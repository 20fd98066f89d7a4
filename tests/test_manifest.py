"""The manifest: valid, linked from the root, and every command it names exists."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest
from npe2 import PluginManifest

from napari_unpack.io.volumes import READABLE
from napari_unpack.widgets.preferences import BACKENDS, Preferences, preferences

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def manifest() -> PluginManifest:
    return PluginManifest.from_file(ROOT / "src" / "napari_unpack" / "napari.yaml")


def test_the_root_manifest_is_a_relative_link_to_the_packaged_one() -> None:
    link = ROOT / "napari.yaml"
    assert link.is_symlink()
    assert link.readlink() == Path("src/napari_unpack/napari.yaml")


def test_every_command_can_be_imported(manifest: PluginManifest) -> None:
    names = [command.python_name for command in manifest.contributions.commands]
    assert len(names) == 7
    for name in names:
        module, attribute = name.split(":")
        assert callable(getattr(importlib.import_module(module), attribute))


def test_the_panel_is_a_widget_and_stands_in_two_menus(manifest: PluginManifest) -> None:
    (widget,) = manifest.contributions.widgets
    assert widget.display_name == "Virtual Unpacking"
    assert set(manifest.contributions.menus) == {"napari/layers/segment", "napari/layers/visualize"}


# Folders have no pattern, and of an .npy napari itself shows all that it says.
@pytest.mark.parametrize("suffix", sorted(set(READABLE) - {".zarr", ".npy"}))
def test_the_reader_is_offered_for_the_formats_of_ct(manifest: PluginManifest, suffix: str) -> None:
    from fnmatch import fnmatch

    reader = manifest.contributions.readers[0]
    assert any(fnmatch(f"bag{suffix}", pattern) for pattern in reader.filename_patterns)
    assert reader.accepts_directories


def test_the_preferences_of_the_manifest_are_the_defaults_in_code(manifest: PluginManifest) -> None:
    pages = manifest.contributions.configurations
    flight, drawing = pages["unpacking"].properties, pages["drawing"].properties
    assert flight["seconds"].default == Preferences().seconds
    assert flight["when_nobody_is_free"].enum == ["Tell me", "Take the least blocked"]
    assert BACKENDS[drawing["backend"].default] == Preferences().backend
    assert drawing["backend"].enum == list(BACKENDS)
    assert drawing["recolor_at_rest"].default is Preferences().recolor_at_rest
    assert drawing["names"].default is Preferences().names
    keep = pages["files"].properties["keep_unsaved"]
    assert keep.default is Preferences().keep_unsaved


@pytest.mark.parametrize(
    ("stored", "taken"), [("Tell me", False), ("Take the least blocked", True)]
)
def test_preferences_stored_by_the_first_version_are_read(
    monkeypatch: pytest.MonkeyPatch, stored: str, taken: bool
) -> None:
    # As napari writes them to the user's disk: keys and values may never change.
    kept = SimpleNamespace(
        unpacking=SimpleNamespace(seconds=2.5, when_nobody_is_free=stored),
        drawing=SimpleNamespace(backend="Graphics card", recolor_at_rest=False),
    )
    monkeypatch.setattr("napari.settings.get_plugin_settings", lambda name: kept)
    assert preferences() == Preferences(2.5, taken, "gl", False)
