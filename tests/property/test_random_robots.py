from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.readers import read
from morphkit.tokens.spec import token_spec
from tests.support.trees import mjcf_robots, urdf_robots

robots = st.one_of(mjcf_robots(), urdf_robots())
quick = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


def cuttable(robot: Description) -> list[str]:
    """Names of all limbs and fixed bodies but the root."""
    return [member for limb in read(robot).limbs for member in limb.members][1:]


def topmost(robot: Description, names: list[str], spec: mujoco.MjSpec) -> list[str]:
    """Those of `names` that do not lie below another; MjSpec.delete must not meet a body twice."""
    tops = []
    for name in names:
        above = spec.body(name).parent
        while above.name != "world" and above.name not in names:
            above = above.parent
        if above.name == "world":
            tops.append(name)
    return tops


def step(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.1
    mujoco.mj_step(model, data, nstep=20)
    return data


@quick
@given(robot=robots)
def test_token_names_are_unique_and_limbs_partition_the_observation(robot):
    morphology = read(robot)
    for naming in ("raw", "canonical"):
        spec = token_spec(morphology, naming=naming)
        names = [token.name for token in spec.sensors]
        assert len(set(names)) == len(names)
        actuators = [token.name for token in spec.actuators]
        assert len(set(actuators)) == len(actuators)
        assert [token.index for token in spec.sensors] == list(range(len(names)))
        owners = spec.token_limb
        assert owners.shape == (len(names),)
        assert np.all(np.diff(owners) >= 0)
        assert set(owners) == set(range(len(morphology.limbs)))
        for index, limb in enumerate(morphology.limbs):
            assert np.sum(owners == index) == 16 + 3 * max(1, len(limb.joints))
            assert {spec.sensors[token].limb for token in np.flatnonzero(owners == index)} == {spec.limbs[index].name}


@quick
@given(robot=robots, data=st.data())
def test_tokens_of_a_variant_are_tokens_of_its_source(robot, data):
    how = data.draw(st.sampled_from(["remove", "splice"]))
    names = data.draw(st.lists(st.sampled_from(cuttable(robot)), min_size=1, max_size=3, unique=True))
    variant = ablate(robot, **{how: names})
    whole, part = read(robot), read(variant.description)
    assert [limb.name for limb in part.limbs] == list(variant.limbs)
    assert not set(variant.limbs) & {*variant.removed, *variant.spliced}
    assert {limb.name for limb in whole.limbs} <= {*variant.limbs, *variant.removed, *variant.spliced}
    for naming in ("raw", "canonical"):
        canonical = variant.description.info.canonical
        before = token_spec(whole, naming=naming, canonical=canonical)
        after = token_spec(part, naming=naming, canonical=canonical)
        assert {token.name for token in after.sensors} <= {token.name for token in before.sensors}
        # A URDF joint that followed a removed one moves on its own now, and can be driven.
        freed = {loss.name for loss in variant.lost if loss.kind == "mimic"}
        driven = {token.name for token in after.actuators if token.joint not in freed}
        assert driven <= {token.name for token in before.actuators}


@quick
@given(robot=robots, data=st.data())
def test_pruned_variants_equal_mjspec_delete_and_step_finitely(robot, data, plain_spec, differences):
    names = data.draw(st.lists(st.sampled_from(cuttable(robot)), min_size=1, max_size=3, unique=True))
    spec = plain_spec(robot)
    for name in topmost(robot, names, spec):
        spec.delete(spec.body(name))
    model = plain_spec(ablate(robot, remove=names).description).compile()
    assert differences(model, spec.compile()) == []
    assert np.isfinite(step(model).qpos).all()


@quick
@given(robot=robots, data=st.data())
def test_kept_limbs_stay_with_all_above_them_and_nothing_else(robot, data, plain_spec):
    whole = read(robot)
    names = data.draw(st.lists(st.sampled_from(cuttable(robot)), min_size=1, max_size=3, unique=True))
    variant = ablate(robot, keep=names)
    limb_of = {member: limb.name for limb in whole.limbs for member in limb.members}
    parents = {limb.name: limb.parent for limb in whole.limbs}
    wanted = set()
    for name in names:
        current = limb_of[name]
        while current is not None:
            wanted.add(current)
            current = parents[current]
    assert set(variant.limbs) == wanted
    assert np.isfinite(step(plain_spec(variant.description).compile()).qpos).all()


@pytest.mark.parametrize("kind", [mjcf_robots, urdf_robots])
@quick
@given(data=st.data())
def test_spliced_limbs_children_keep_orientations_and_get_its_anchor_in_every_pose(kind, data, plain_spec):
    robot = data.draw(kind())
    whole = read(robot)
    parents = {limb.parent for limb in whole.limbs} - {whole.root.name, None}
    carrying = [name for name in cuttable(robot) if name in parents]
    names = data.draw(st.lists(st.sampled_from(carrying or cuttable(robot)), min_size=1, max_size=3, unique=True))
    variant = ablate(robot, splice=names)
    before, after = plain_spec(robot).compile(), plain_spec(variant.description).compile()
    assert np.isfinite(step(after).qpos).all()
    gone = {*names, *(member for limb in whole.limbs if limb.name in names for member in limb.members)}
    old, new = mujoco.MjData(before), mujoco.MjData(after)
    mujoco.mj_forward(before, old)
    mujoco.mj_forward(after, new)
    for index in range(1, after.nbody):
        np.testing.assert_allclose(abs(new.xquat[index] @ old.body(after.body(index).name).xquat), 1, atol=1e-9)
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    for _ in range(3):
        # Whatever the joints that went are at, the anchor of the first does not depend on it.
        pose = {before.joint(joint).name: random.uniform(-1, 1, 7) for joint in range(before.njnt)}
        for model, state in ((before, old), (after, new)):
            for joint in range(model.njnt):
                width = 7 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE else 1
                start = model.jnt_qposadr[joint]
                state.qpos[start : start + width] = pose[model.joint(joint).name][:width]
            mujoco.mj_normalizeQuat(model, state.qpos)
            mujoco.mj_kinematics(model, state)
        for index in range(1, after.nbody):
            above = before.body(after.body(index).name).parentid[0]
            top = 0
            while before.body(above).name in gone:
                top, above = above, before.body_parentid[above]
            if top:
                np.testing.assert_allclose(_anchor(after, new, index), _anchor(before, old, top), atol=1e-9)


def _anchor(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> np.ndarray:
    """Where the first joint of a body is anchored in the world; its origin where it has none."""
    return data.xanchor[model.body_jntadr[body]] if model.body_jntnum[body] else data.xpos[body]
