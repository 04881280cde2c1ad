"""All bodies that can be cut out of a robot, written with a manifest."""
