from __future__ import annotations

import mujoco
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trees import mjcf_robots, urdf_robots

from morphkit.ablation import ablate
from morphkit.description import Description
from morphkit.io import read
from morphkit.tokens import tokens

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
        spec = tokens(morphology, naming=naming)
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
        before = tokens(whole, naming=naming, canonical=canonical)
        after = tokens(part, naming=naming, canonical=canonical)
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
def test_spliced_variants_keep_orientations_and_anchors_and_step_finitely(robot, data, plain_spec):
    whole = read(robot)
    name = data.draw(st.sampled_from(cuttable(robot)))
    variant = ablate(robot, splice=[name])
    before, after = plain_spec(robot).compile(), plain_spec(variant.description).compile()
    assert np.isfinite(step(after).qpos).all()
    old, new = mujoco.MjData(before), mujoco.MjData(after)
    mujoco.mj_forward(before, old)
    mujoco.mj_forward(after, new)
    group = next((limb.members for limb in whole.limbs if limb.name == name), (name,))
    anchor = _anchor(before, old, before.body(name).id)
    for index in range(1, after.nbody):
        body = after.body(index).name
        np.testing.assert_allclose(abs(new.body(body).xquat @ old.body(body).xquat), 1, atol=1e-9)
        source = before.body(body)
        if before.body(source.parentid[0]).name in group:
            np.testing.assert_allclose(_anchor(after, new, index), anchor, atol=1e-9)


def _anchor(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> np.ndarray:
    """Where the first joint of a body is anchored in the world; its origin where it has none."""
    return data.xanchor[model.body_jntadr[body]] if model.body_jntnum[body] else data.xpos[body]
