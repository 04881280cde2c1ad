"""Robots in MuJoCo: models to train in and models to look at."""
