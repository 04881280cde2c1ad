"""Robots, run folders and kinematic trees that several tests share."""
