"""The tree in the terminal, for which no heavy package is imported."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from rich.console import Console

from morphkit.morphology import Actuator, Joint, Limb, Morphology
from morphkit_cli import robot_tree


def printed(morphology: Morphology) -> str:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(robot_tree.tree(morphology))
    return capture.get()


def robot() -> Morphology:
    shoulder = (Joint("yaw", "hinge", True, -np.pi / 2, np.pi), Joint("lift", "slide", True, -0.25, 0.5))
    return Morphology(
        name="arm[1]",
        file="arm.xml",
        format="mjcf",
        sha256="0" * 64,
        base="fixed",
        family=None,
        task=None,
        type_words=(),
        limbs=(
            Limb("base", None, (), ("base",)),
            Limb("shoulder", "base", shoulder, ("shoulder", "plate"), "shoulder"),
            Limb("hand", "shoulder", (Joint("spin", "hinge", False, 0, 0),), ("hand",)),
        ),
        actuators=(
            Actuator("m_yaw", "shoulder", "yaw", -1, 1, "1"),
            Actuator("m_lift", "shoulder", "lift", -20, 20, "N"),
            Actuator("m_hand", "hand", "spin", -np.inf, np.inf, "N*m"),
            Actuator("tendon", None, None, 0, 1, "1"),
        ),
    )


def test_tree_shows_limbs_joints_and_actuators_with_units() -> None:
    assert printed(robot()).splitlines() == [
        "arm[1]  MJCF · fixed base · 3 limbs · 3 joints · 4 actuators",
        "├── base",
        "│   └── shoulder  shoulder",
        "│       hinge yaw -90.0 to 180.0°  actuator m_yaw -1 to 1",
        "│       slide lift -0.25 to 0.5 m  actuator m_lift -20 to 20 N",
        "│       fixed to it: plate",
        "│       └── hand",
        "│           hinge spin unlimited  actuator m_hand unbounded N*m",
        "└── actuators that drive no single limb",
        "    └── actuator tendon 0 to 1",
    ]


def test_viewing_imports_no_heavy_package() -> None:
    heavy = {"mujoco", "matplotlib", "imageio", "PIL", "torch"}
    code = f"import sys, morphkit_cli.robot_tree; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "set()"
