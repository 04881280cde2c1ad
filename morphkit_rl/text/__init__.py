"""Names of sensors and actuators as vectors of a frozen, pretrained text encoder."""
