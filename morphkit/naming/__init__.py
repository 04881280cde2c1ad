"""Names of limbs: in plain words, unique, and the patterns that pick them."""
