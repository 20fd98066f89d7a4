"""Volume to labels: foreground, components, recursive isoperimetric splitting, evaluation."""
