"""morphkit_rl: one policy over many morphologies. Importing it registers the Gymnasium ids `morphkit/<robot>-v0`."""

from morphkit_rl.envs.registration import register_robots

register_robots()
