"""Packed bags with ground truth."""
