"""All 32 bodies of the benchmark against its rules, written out anew over plain MuJoCo.

The rules here share nothing with the environments: velocities come from Jacobians, not from sensors, and limits and
limb types from the numbers in `tests/data`.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.registry import load
from morphkit.simulation.build import Simulation, build_simulation, compile_plain
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.tasks import task_for

BODIES = json.loads((Path(__file__).parents[3] / "data" / "benchmark_bodies.json").read_text())
TYPE_WORDS = {
    "cheetah": ("torso", "thigh", "shin", "foot"),
    "walker": ("torso", "1", "2", "3"),
    "humanoid_2d": ("hip", "knee", "shoulder", "elbow"),
    "hopper": ("torso", "thigh", "leg", "foot"),
}
MODES = ("fixed", "legacy")
ENVS = 2


@cache
def simulation(body: str) -> Simulation:
    return build_simulation(load(body))


@cache
def plain(body: str) -> mujoco.MjModel:
    return compile_plain(load(body))


def at(body: str, qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(plain(body))
    data.qpos, data.qvel = qpos, qvel
    mujoco.mj_forward(plain(body), data)
    return data


def limb_type(body: str, limb: int, observation: str) -> list[float]:
    """One-hot over the family's words; the first that occurs counts."""
    model, family = plain(body), BODIES[body]["robot"]
    name = model.body(limb).name
    if family == "humanoid_2d":  # its words are in joint names, which the published code did not look at
        name = model.joint(model.body_jntadr[limb]).name if limb > 1 and observation == "fixed" else ""
    hits = [word in name for word in TYPE_WORDS[family]]
    return [float(i == hits.index(True)) if any(hits) else 0.0 for i in range(4)]


def expected_obs(body: str, data: mujoco.MjData, observation: str) -> np.ndarray:
    model, rows = plain(body), []
    for limb in range(1, model.nbody):
        linear, angular, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv)), np.zeros(3)
        mujoco.mj_jacBody(model, data, linear, angular, limb)
        mujoco.mju_quat2Vel(turn, data.xquat[limb], 1.0)
        position, velocity, rotation = data.xpos[limb].copy(), linear @ data.qvel, angular @ data.qvel
        if observation == "fixed":
            position[0] -= data.xpos[1, 0]
        elif limb == 1:
            velocity[2] += rotation[1] * position[0]
            position[0] = 0
        joint = model.body_jntadr[limb]
        low, high = model.jnt_range[joint]
        angle = (data.qpos[model.jnt_qposadr[joint]] - low) / (high - low) if limb > 1 else 0
        of_joint = [angle, *(180 + np.degrees([low, high])) / 360] if limb > 1 else [0, 0, 0]
        types = limb_type(body, limb, observation)
        rows += [*position, *np.clip(velocity, -10, 10), *rotation, *turn, *types, *of_joint]
    return np.array(rows)


def expected_step(body: str, data: mujoco.MjData, ctrl: np.ndarray) -> tuple[float, bool]:
    """Advance `data` by a control step; its reward and whether it ends the episode."""
    model, family, before = plain(body), BODIES[body]["robot"], data.qpos[0]
    data.ctrl = ctrl
    mujoco.mj_step(model, data, nstep=4)
    speed = (data.qpos[0] - before) / (4 * model.opt.timestep)
    if family == "cheetah":
        return speed - 0.1 * ctrl @ ctrl, False
    low, high = BODIES[body]["healthy_height_m"]
    healthy = low < data.qpos[1] < (np.inf if high is None else high) and abs(data.qpos[2]) < 1
    if family == "hopper":
        healthy = healthy and np.abs(np.concatenate([data.qpos, data.qvel])[2:]).max() < 100
    return speed + 1 - 0.001 * ctrl @ ctrl, not healthy


def starts(body: str, kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    model = plain(body)
    qpos = np.tile(model.qpos0, (ENVS, 1)) + rng.uniform(-0.1, 0.1, (ENVS, model.nq))
    qvel = rng.normal(0, 0.5, (ENVS, model.nv))
    if kind == "far":
        qpos[:, 0] += rng.uniform(-30, 30, ENVS)
    if kind == "fast":
        qvel *= 30
        qvel[0, -1] = 150  # beyond what a hopper survives
    if kind == "turned":
        qpos[:, 1] += 0.5
        qpos[:, 2] += rng.uniform(1.2, 5, ENVS) * rng.choice([-1, 1], ENVS)
        qpos[0, 2] = 1.05  # just beyond what a walker survives
    return qpos, qvel


@pytest.mark.parametrize("body", BODIES)
def test_body_follows_the_rules(body: str) -> None:
    own, ended = simulation(body), 0
    envs = {
        mode: BatchEnv([own], [task_for(own)], ENVS, observation=mode, autoreset=False, num_threads=1) for mode in MODES
    }
    rng = np.random.default_rng(len(body))
    for kind in ("near", "far", "fast", "turned"):
        qpos, qvel = starts(body, kind, rng)
        for mode, env in envs.items():
            obs = env.set_state(0, qpos, qvel)
            for row, state in zip(obs, zip(qpos, qvel, strict=True), strict=True):
                np.testing.assert_allclose(row, expected_obs(body, at(body, *state), mode), rtol=1e-6, atol=1e-5)
        for _ in range(3):
            qpos, qvel = envs["fixed"].state(0)
            ctrl = rng.uniform(-1, 1, (ENVS, own.model.nu))
            steps = {mode: env.step([ctrl]) for mode, env in envs.items()}
            for i in range(ENVS):
                data = at(body, qpos[i], qvel[i])
                data.qacc_warmstart = 0
                reward, terminated = expected_step(body, data, ctrl[i])
                np.testing.assert_array_equal(envs["fixed"].state(0)[0][i], data.qpos)
                np.testing.assert_array_equal(envs["fixed"].state(0)[1][i], data.qvel)
                now = at(body, data.qpos, data.qvel)
                for mode, step in steps.items():
                    assert step.reward[0][i] == pytest.approx(reward, abs=1e-6)
                    assert step.terminated[0][i] == terminated
                    np.testing.assert_allclose(
                        step.final_obs[0][i], expected_obs(body, now, mode), rtol=1e-6, atol=1e-5
                    )
                ended += terminated
    assert (ended > 0) == (BODIES[body]["robot"] != "cheetah")


@pytest.mark.parametrize("body", [body for body in BODIES if BODIES[body]["healthy_height_m"]])
def test_episode_ends_at_the_height_itself(body: str) -> None:
    """Without gravity and contacts a resting robot stays where it is, to the last bit."""
    own = simulation(body)
    still = build_simulation(load(body))
    still.model.opt.gravity[:] = 0
    still.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    low, high = BODIES[body]["healthy_height_m"]
    heights = [low, np.nextafter(low, 9)] + ([np.nextafter(high, 0), high] if high is not None else [])
    env = BatchEnv([still], [task_for(own)], len(heights), autoreset=False)
    qpos = np.tile(own.model.qpos0, (len(heights), 1))
    qpos[:, 1] = heights
    env.set_state(0, qpos, np.zeros((len(heights), own.model.nv)))
    ended = env.step([np.zeros((len(heights), own.model.nu))]).terminated[0]
    np.testing.assert_array_equal(env.state(0)[0][:, 1], heights)
    np.testing.assert_array_equal(ended, [True, False, False, True][: len(heights)])


@pytest.mark.parametrize("body", BODIES)
def test_start_states_and_lengths(body: str) -> None:
    cheetah = BODIES[body]["robot"] == "cheetah"
    task, model = task_for(simulation(body)), plain(body)
    assert (task.frame_skip, task.episode_length) == (4, 1000)
    env = BatchEnv([simulation(body)], [task], 400, num_threads=1)
    env.reset()
    qpos, qvel = env.state(0)
    offset, bound = qpos - model.qpos0, 0.1 if cheetah else 0.005
    assert 0.99 * bound < np.abs(offset).max() <= bound * (1 + 1e-9)
    assert offset.std() == pytest.approx(bound / np.sqrt(3), rel=0.05)
    if cheetah:
        assert qvel.std() == pytest.approx(0.1, rel=0.05)
        assert np.abs(qvel).max() > 0.2
    else:
        assert 0.99 * bound < np.abs(qvel).max() <= bound


def test_humanoids_have_types_in_fixed_observations_only() -> None:
    kinds = {}
    for mode in MODES:
        own = simulation("humanoid_2d_9_full")
        obs = BatchEnv([own], [task_for(own)], 1, observation=mode).reset()[0].reshape(9, 19)
        kinds[mode] = obs[:, 12:16]
    assert not kinds["legacy"].any()
    order = {limb: i for i, limb in enumerate(BODIES["humanoid_2d_9_full"]["limbs"])}
    assert not kinds["fixed"][order["torso"]].any()
    expected = {"right_thigh": 0, "left_shin": 1, "left_upper_arm": 2, "right_lower_arm": 3}
    for limb, index in expected.items():
        np.testing.assert_array_equal(kinds["fixed"][order[limb]], np.eye(4)[index])
