"""Which packages are installed; everything else is in pyproject.toml, which cannot rename a folder that it finds."""

from setuptools import find_packages, setup

# `cli`, `robots` and `zoo` are installed under names that do not clash with other people's.
RENAMED = {"morphkit_cli": "cli", "morphkit_robots": "robots", "morphkit_zoo": "zoo"}

setup(
    packages=[
        *find_packages(include=["morphkit", "morphkit.*", "morphkit_rl", "morphkit_rl.*"]),
        *RENAMED,
        *(f"{name}.{package}" for name, folder in RENAMED.items() for package in find_packages(folder)),
    ],
    package_dir=RENAMED,
)
