from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphkit.ablation.limb_scale import LimbScale
from morphkit.description import Description
from morphkit.readers import read
from morphkit.scaling.draw import ScaleRanges, draw_scales
from morphkit.scaling.scale import scale_limbs
from tests.support.trees import mjcf_robots, urdf_robots

robots = st.one_of(mjcf_robots(), urdf_robots())
factors = st.sampled_from([0.5, 0.9, 1.0, 1.25, 2.0])
quick = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


def scaled(robot: Description, scales: dict[str, LimbScale]) -> Description:
    return scale_limbs(robot, scales).description


def limb_names(robot: Description) -> list[str]:
    return [limb.name for limb in read(robot).limbs]


def state(model: mujoco.MjModel, slides: dict[str, float] | None = None, seed: int = 0) -> mujoco.MjData:
    """The model in a random pose; `slides` are factors of the coordinates of slides, by joint."""
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        address = model.jnt_qposadr[joint]
        value = random.uniform(-1, 1)
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            data.qpos[address] = value * (slides or {}).get(model.joint(joint).name, 1.0)
        elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            data.qpos[address] = value
    mujoco.mj_forward(model, data)
    return data


@quick
@given(robot=robots)
def test_factor_one_leaves_every_byte(robot):
    assert scaled(robot, dict.fromkeys(limb_names(robot), LimbScale())).source == robot.source


@quick
@given(robot=robots, length=factors, mass=factors, gain=factors)
def test_one_factor_for_all_limbs_makes_a_similar_robot(robot, length, mass, gain, plain_spec):
    variant = scaled(robot, dict.fromkeys(limb_names(robot), LimbScale(length, mass, gain)))
    before, after = plain_spec(robot).compile(), plain_spec(variant).compile()
    np.testing.assert_allclose(after.body_mass, before.body_mass * length**3 * mass, rtol=1e-9)
    np.testing.assert_allclose(after.body_inertia, before.body_inertia * length**5 * mass, rtol=1e-9)
    np.testing.assert_allclose(after.geom_size, before.geom_size * length, rtol=1e-12)
    slides = {before.joint(joint).name: length for joint in range(before.njnt)}
    old, new = state(before), state(after, slides)
    root = read(robot).root.name
    first = before.body(root).id
    np.testing.assert_allclose(
        new.xpos[1:] - new.xpos[first], length * (old.xpos[1:] - old.xpos[first]), atol=1e-12, rtol=0
    )
    np.testing.assert_allclose(new.xquat, old.xquat, atol=1e-12)
    np.testing.assert_allclose(after.jnt_range[:, 0], before.jnt_range[:, 0] * travel(before, length), atol=1e-12)
    assert [each.high for each in read(variant).actuators] == pytest.approx(
        [each.high * expected(before, each, length, gain) for each in read(robot).actuators]
    )


def travel(model: mujoco.MjModel, length: float) -> np.ndarray:
    return np.where(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, length, 1.0)


def expected(model: mujoco.MjModel, actuator, length: float, gain: float) -> float:
    """Factor of a control: a motor's grows with the gain, that of a servo with the coordinate that it sets."""
    if model.nu and model.actuator(actuator.name).biasprm[1] != 0:
        joint = model.joint(actuator.joint)
        return length if joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
    return gain


@quick
@given(robot=robots, data=st.data())
def test_limbs_still_meet_at_their_joints(robot, data, plain_spec):
    names = limb_names(robot)
    scales = {name: LimbScale(length=data.draw(factors)) for name in names}
    before, after = plain_spec(robot).compile(), plain_spec(scaled(robot, scales)).compile()
    morphology = read(robot)
    of_joint = {joint.name: scales[limb.name].length for limb in morphology.limbs for joint in limb.joints}
    # Where all joints are at zero, so that the anchors of several joints of one limb do not move each other.
    old, new = mujoco.MjData(before), mujoco.MjData(after)
    mujoco.mj_forward(before, old)
    mujoco.mj_forward(after, new)
    for limb in morphology.limbs[1:]:
        joint = limb.joints[0].name
        above = before.body(before.body(limb.name).parentid[0]).name
        old_anchor = old.body(above).xmat.reshape(3, 3).T @ (old.joint(joint).xanchor - old.body(above).xpos)
        new_anchor = new.body(above).xmat.reshape(3, 3).T @ (new.joint(joint).xanchor - new.body(above).xpos)
        np.testing.assert_allclose(new_anchor, scales[limb.parent].length * old_anchor, atol=1e-12)
        away = new.body(limb.name).xpos - new.joint(joint).xanchor
        np.testing.assert_allclose(
            away, of_joint[joint] * (old.body(limb.name).xpos - old.joint(joint).xanchor), atol=1e-12
        )
    mujoco.mj_step(after, new, nstep=20)
    assert np.isfinite(new.qpos).all()


@quick
@given(seed=st.integers(0, 2**31), sample=st.integers(1, 5))
def test_factors_lie_within_their_ranges_and_are_shared_by_mirror_images(seed, sample):
    ranges = ScaleRanges(length=(0.8, 1.2), mass=(0.5, 0.50004), gain=(2.0, 2.0))
    limbs = ["trunk", "left_leg", "left_foot", "right_leg", "right_foot"]
    image = {"left_leg": "right_leg", "right_leg": "left_leg", "trunk": "trunk"}
    scales = draw_scales(limbs, image, ranges, seed=seed, sample=sample)
    assert scales == draw_scales(limbs, image, ranges, seed=seed, sample=sample)
    assert scales != draw_scales(limbs, image, ranges, seed=seed, sample=sample + 1)
    assert scales["left_leg"] == scales["right_leg"] != scales["trunk"]
    assert scales["left_foot"] != scales["right_foot"]
    for scale in scales.values():
        assert 0.8 <= scale.length <= 1.2
        assert 0.5 <= scale.mass <= 0.50004
        assert scale.gain == 2.0
