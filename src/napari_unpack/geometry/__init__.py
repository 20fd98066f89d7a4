"""Axes, boxes, views, rays and poses: what all other packages stand on."""
