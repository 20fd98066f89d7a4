"""What is mended once objects are known: cables, inclusions, cavities, crumpled cloth."""
