"""Named sensor and actuator tokens of a robot."""
