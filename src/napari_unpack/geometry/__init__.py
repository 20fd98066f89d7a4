"""Axes, boxes, views, rays and rigid placements: the ground every other room stands on."""
