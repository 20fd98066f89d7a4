"""What objects look like: transfer function, interference, colouring, hues."""
