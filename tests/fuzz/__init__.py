"""Broken robot files for the readers and for ablation, and broken run folders; see `make fuzz`."""
