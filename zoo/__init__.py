"""The trained policies that ship with morphkit, installed as `morphkit_zoo`: one folder a policy."""
