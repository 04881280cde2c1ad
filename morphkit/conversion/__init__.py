"""URDF into a simulatable MJCF."""
