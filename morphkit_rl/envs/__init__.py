"""Batched environments on `mujoco.rollout`, and tasks as data."""
