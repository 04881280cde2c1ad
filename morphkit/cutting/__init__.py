"""Cuts in the XML source of a robot: what goes, what refers to it, and what is written back byte for byte."""
