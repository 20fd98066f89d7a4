"""Dock widgets: they wire, they compute nothing."""
