"""Which voxels belong to the bag: thresholds, Mumford-Shah, and what is scanner or bag shell."""
