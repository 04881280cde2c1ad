"""Bodies of other proportions: lengths, masses and gains of a robot's limbs, scaled in its file."""
