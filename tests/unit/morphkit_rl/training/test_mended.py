"""Training takes what can be mended and says so, or refuses it where it is asked to."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.runs import run_settings
from morphkit_rl.training.trainer import resume, train

LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="{1}" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial><visual><geometry><mesh filename="lost.stl"/></geometry></visual>
<collision><geometry><sphere radius=".05"/></geometry></collision></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 -.2"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="{3}" effort="5" velocity="10"/></joint>"""


def robot() -> Description:
    """An impossible inertia, a link without a mass, no meshes, and a knee that cannot be straight."""
    links = LINK.format("trunk", "-.01") + LINK.format("thigh", ".01") + LINK.format("calf", ".01")
    joints = JOINT.format("hip", "trunk", "thigh", "2") + JOINT.format("knee", "thigh", "calf", "-1")
    joints += '<link name="toe"/>' + JOINT.format("ankle", "calf", "toe", "2")
    return Description("leg", "leg.urdf", "urdf", f'<robot name="leg">{links}{joints}</robot>'.encode())


@pytest.fixture
def config() -> TrainConfig:
    small = ("model.d_model=16", "model.layers=1", "model.feedforward=16", "trainer.num_envs=2", "td3.batch_size=16")
    return load_config(overrides=list(small))


def test_what_was_mended_is_said_once_and_kept(tmp_path: Path, config: TrainConfig) -> None:
    cut = ablate(robot(), remove=["toe"], name="cut").description
    said: list[str] = []
    train([robot(), cut], tmp_path / "run", config, base="free", steps=8, notice=said.append)
    assert next(line for line in said if "inertia of link 'trunk' is impossible" in line).startswith("leg and 1 more: ")
    assert next(line for line in said if "'toe' moves and has no mass" in line).startswith("leg: ")
    assert len(said) == len(set(said))
    resume(tmp_path / "run", steps=12)
    kept = json.loads((tmp_path / "run" / run_settings.CONFIG).read_text())["mended"]
    assert {line.partition(": ")[2] for line in said} == {line for lines in kept.values() for line in lines}
    assert any("lost.stl" in line for line in kept["cut"])


def test_strict_refuses_it_before_anything_is_written(tmp_path: Path, config: TrainConfig) -> None:
    with pytest.raises(ConfigError, match=r"leg: .*; \d+ more\. --strict refuses what has to be mended"):
        train([robot()], tmp_path / "run", config, base="free", steps=8, strict=True)
    assert not (tmp_path / "run").exists()
