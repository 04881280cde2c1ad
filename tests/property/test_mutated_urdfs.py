"""What `check` passes, everything takes: its text rules alone foresee whatever the simulator refuses."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.readers import read
from morphkit.simulation.build import build_simulation
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.validation.check import check
from tests.support.mutated_urdfs import SEED, mutated_urdfs

quick = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def errors(source: bytes) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.urdf"
        path.write_bytes(source)
        return check(path, deep=False).count("error")


@quick
@given(source=mutated_urdfs())
def test_what_check_passes_is_read_converted_simulated_and_drawn(source: bytes) -> None:
    if errors(source):
        return
    robot = Description("r", "r.urdf", "urdf", source)
    conversion = convert(robot, thorough=False)
    convert(robot, base="free", thorough=False)
    load_mechanics(robot)
    simulation = build_simulation(robot)
    morphology = read(robot)
    assert conversion.motors == len(morphology.actuators) == simulation.model.nu
    model = conversion.spec.compile()
    own = {joint.name for joint in morphology.joints}
    assert own <= {model.joint(number).name for number in range(model.njnt)}
    assert model.body_subtreemass[0] == pytest.approx(simulation.model.body_subtreemass[0])
    assert np.isfinite(model.body_pos).all()
    for joint in morphology.joints:
        number = model.joint(joint.name).id
        assert bool(model.jnt_limited[number]) == joint.limited
        assert not joint.limited or model.jnt_range[number] == pytest.approx([joint.low, joint.high])


def test_the_robot_that_is_changed_is_sound() -> None:
    assert errors(SEED) == 0
