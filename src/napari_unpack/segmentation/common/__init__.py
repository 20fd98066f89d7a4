"""What several steps of segmentation share: regions, boxes, adjacency, hulls, measures."""
