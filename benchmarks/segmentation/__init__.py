"""How well bags are segmented, beside the plain peers: `python -m benchmarks.segmentation`."""
