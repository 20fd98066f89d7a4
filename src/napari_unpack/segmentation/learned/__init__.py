"""The default method: a boundary network, its fragments, and the classifiers that merge them."""
