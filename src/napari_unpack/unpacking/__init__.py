"""What may leave, in which order, along which path, and where it waits."""
