"""The one door to both rendering backends: it chooses, and never computes."""
