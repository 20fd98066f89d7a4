"""Fixtures of the tests of napari's layers: they open a real viewer."""

from viewer_fixtures import *  # noqa: F403
