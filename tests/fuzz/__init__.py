"""Broken robot files for the readers and for ablation; see `make fuzz`."""
