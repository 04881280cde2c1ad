"""The robot description files that ship with morphkit, installed as `morphkit_robots`: one folder a robot."""
