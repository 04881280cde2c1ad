"""Findings about robot description files: what is wrong, where, why it matters and how to mend it."""
