"""Fixtures of the tests of the panel: they open a real viewer."""

from viewer_fixtures import *  # noqa: F403
