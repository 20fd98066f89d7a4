"""Segmentation of held-out bags."""
