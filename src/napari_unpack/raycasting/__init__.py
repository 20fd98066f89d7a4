"""The CPU backend: numba ray casters with empty-space skipping."""
