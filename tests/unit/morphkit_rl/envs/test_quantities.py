"""One entry in the table of limb quantities is all that a new quantity takes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit.tokens import quantities
from morphkit.tokens.quantities import LIMB_QUANTITIES, LimbQuantity, numbers_per_limb, quantity_columns, quantity_names
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.tasks import task_for

UPRIGHT = LimbQuantity("upright", "xyz", "1", "world", sensor="framezaxis", width=3)


def test_columns_follow_one_another() -> None:
    assert numbers_per_limb() == 13
    assert quantity_columns("position") == slice(0, 3)
    assert quantity_columns("exponential_map") == slice(9, 13)
    assert quantity_names()[-4:] == ("type", "angle", "joint_range_low", "joint_range_high")
    with pytest.raises(KeyError):
        quantity_columns("type")


@pytest.mark.parametrize("place", [0, 2, len(LIMB_QUANTITIES)])
@pytest.mark.parametrize("robot", ["cheetah", "arm", "quadruped"])
def test_an_entry_gives_tokens_sensors_and_observations(
    monkeypatch: pytest.MonkeyPatch, robot: str, place: int
) -> None:
    def rollout() -> tuple[BatchEnv, np.ndarray, list[np.ndarray]]:
        simulation = build_simulation(load(robot), base="free" if robot == "quadruped" else None)
        env = BatchEnv([simulation], [task_for(simulation)], 2, seed=3, num_threads=1)
        env.reset()
        results = [env.step([np.full((2, len(simulation.tokens.actuators)), 0.3)]) for _ in range(5)]
        return env, results[-1].obs[0], [result.reward[0] for result in results]

    before, old, old_rewards = rollout()
    table = (*LIMB_QUANTITIES[:place], UPRIGHT, *LIMB_QUANTITIES[place:])
    monkeypatch.setattr(quantities, "LIMB_QUANTITIES", table)
    env, new, rewards = rollout()
    tokens = env.specs[0].sensors
    added = np.array([token.quantity == "upright" for token in tokens])
    assert added.sum() == 3 * len(env.specs[0].limbs)
    assert {(token.unit, token.frame) for token in tokens if token.quantity == "upright"} == {("1", "world")}
    assert [token.name for token in tokens if token.quantity != "upright"] == [t.name for t in before.specs[0].sensors]
    np.testing.assert_array_equal(new[:, ~added], old)
    np.testing.assert_array_equal(rewards, old_rewards)

    simulation = env.simulations[0]
    model, data = simulation.model, mujoco.MjData(simulation.model)
    qvel = np.random.default_rng(0).normal(size=(2, model.nv))
    qpos = np.tile(model.qpos0, (2, 1))
    for row, velocity in zip(qpos, qvel, strict=True):
        mujoco.mj_integratePos(model, row, velocity, 0.3)
    seen = env.set_state(0, qpos, qvel)
    for number in range(2):
        data.qpos, data.qvel = qpos[number], qvel[number]
        mujoco.mj_forward(model, data)
        axes = data.xmat[simulation.limb_body].reshape(-1, 3, 3)[:, :, 2]
        np.testing.assert_allclose(seen[number, added], axes.ravel(), atol=1e-6)
    before.close()
    env.close()
