"""vispy visuals that draw what the passes made."""
