"""Attacks on the project by files that are made for it; see `make fuzz`."""
