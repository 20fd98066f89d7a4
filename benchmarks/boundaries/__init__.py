"""How the network of boundaries is trained; see `train.py`."""
