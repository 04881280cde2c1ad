"""Replay: the transitions that are learned from."""
