"""Cutting limbs off a robot by editing its source file."""
