"""Speed and accuracy against peers, measured in one run: `python -m benchmarks`."""
