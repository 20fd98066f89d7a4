"""The paper's Figures 7 and 8 over a whole unpacking; `figures.py` draws them."""
