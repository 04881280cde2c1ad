"""The command line, installed as `morphkit_cli`: one module a command."""
