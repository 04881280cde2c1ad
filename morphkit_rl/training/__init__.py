"""A training run from start to end: collecting, updating, evaluating, resuming."""
