"""A body whose simulation diverges is said to, and a run on a body that does nothing else fails."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.main import run as morphkit

BODY = """<mujoco><worldbody><geom type="plane" size="5 5 1"/><body name="box" pos="0 0 1"><freejoint/><geom size=".1"/>
<body name="arm"><joint name="j" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/></body></body>
</worldbody><actuator><motor name="m" joint="j" gear="{}" ctrlrange="-1 1"/></actuator></mujoco>"""
SMALL = ["trainer.num_envs=2", "trainer.start_steps=8", "td3.batch_size=4", "model.d_model=16", "model.layers=1"]


@pytest.fixture
def train(tmp_path: Path):
    def train(*gears: float, run: str = "run", steps: int = 40) -> int:
        for number, gear in enumerate(gears):
            (tmp_path / f"r{number}.xml").write_text(BODY.format(gear))
        robots = [str(tmp_path / f"r{number}.xml") for number in range(len(gears))]
        settings = [word for setting in SMALL for word in ("--set", setting)]
        options = ["--run", str(tmp_path / run), "--steps", str(steps), "--task", "locomotion", "--quiet"]
        return morphkit(["train", *robots, *options, *settings])

    return train


def test_a_run_on_a_body_that_only_diverges_fails(tmp_path: Path, capsys, train) -> None:
    assert train(1, 1e14) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"error: {tmp_path}/run: the simulation diverged in every episode of r1 (20): ")
    assert morphkit(["train", "--run", str(tmp_path / "run"), "--resume", "--steps", "48", "--quiet"]) == 1
    assert "every episode of r1 (24)" in capsys.readouterr().err
    assert morphkit(["evaluate", str(tmp_path / "run"), str(tmp_path / "r1.xml"), "--episodes", "2", "--json"]) == 0
    printed = capsys.readouterr()
    assert "r1: every episode of the random policy ended because the simulation diverged" in printed.err
    assert '"random_diverged": 2' in printed.out


def test_a_run_on_sound_bodies_says_nothing(capsys, train) -> None:
    assert train(1) == 0
    assert capsys.readouterr().err == ""
