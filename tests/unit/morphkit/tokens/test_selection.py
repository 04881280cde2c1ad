from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit.tokens.quantities import quantity_names
from morphkit.tokens.selection import take_quantities
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_cli.main import run
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare
from morphkit_rl.envs.selection import sensor_columns

CHEETAH, ARM = build_simulation(load("cheetah_3_balanced")), build_simulation(load("arm"))


def names(spec: TokenSpec) -> list[str]:
    return [sensor.name for sensor in spec.sensors]


def test_quantities_are_those_of_the_tokens() -> None:
    assert tuple(dict.fromkeys(sensor.quantity for sensor in ARM.tokens.sensors)) == quantity_names()


def test_without_the_limb_type_vector_a_limb_has_15_scalars() -> None:
    left = take_quantities(CHEETAH.tokens, ["no_ltv"])
    assert len(left.sensors) == 3 * 15
    assert names(left) == [name for name in names(CHEETAH.tokens) if "_type_" not in name]
    assert [sensor.index for sensor in left.sensors] == list(range(45))
    assert left.actuators == CHEETAH.tokens.actuators


def test_any_quantities_in_any_order_keep_the_order_of_the_tokens() -> None:
    left = take_quantities(CHEETAH.tokens, ["translational_velocity", "position"])
    assert names(left)[:6] == [f"torso_{q}_{c}" for q in ("position", "translational_velocity") for c in "xyz"]
    assert take_quantities(CHEETAH.tokens, ["no_ltv", "type"]) == CHEETAH.tokens
    assert take_quantities(CHEETAH.tokens, []) == CHEETAH.tokens


def test_unknown_quantities_are_refused_and_the_nearest_offered() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'position'"):
        take_quantities(CHEETAH.tokens, ["positon"])
    with pytest.raises(ConfigError, match="no token measures angle"):
        take_quantities(take_quantities(CHEETAH.tokens, ["position"]), ["angle"])


@pytest.mark.parametrize("observation", ["fixed", "legacy"])
@pytest.mark.parametrize("quantities", [("no_ltv",), ("position", "translational_velocity"), ("angle", "type")])
def test_a_batch_gives_the_chosen_columns(observation: str, quantities: tuple[str, ...]) -> None:
    robots = [prepare(load(name), sensors=quantities) for name in ("cheetah_3_balanced", "arm", "humanoid_2d")]
    simulations, tasks = [robot.simulation for robot in robots], [robot.task for robot in robots]
    specs = [robot.spec for robot in robots]
    some = BatchEnv(simulations, tasks, 2, specs=specs, observation=observation, seed=3)
    everything = BatchEnv(simulations, tasks, 2, observation=observation, seed=3)
    some.reset(), everything.reset()
    for _ in range(5):
        actions = [np.full((2, len(spec.actuators)), 0.3) for spec in specs]
        few, all_ = some.step(actions), everything.step(actions)
    for spec, simulation, obs, full in zip(specs, simulations, few.obs, all_.obs, strict=True):
        keep = [sensor.quantity in {s.quantity for s in spec.sensors} for sensor in simulation.tokens.sensors]
        np.testing.assert_array_equal(obs, full[:, keep])
        assert obs.shape[1] == len(spec.sensors) < full.shape[1]


def test_names_and_texts_do_not_matter_to_a_batch() -> None:
    robot = prepare(load("humanoid_2d"), "canonical", limb_names="joint", text_style="raw")
    assert robot.spec.sensors[19].text == "right_hip_y_position_x"
    env = BatchEnv([robot.simulation], [robot.task], 1, specs=[robot.spec], seed=1)
    plain = BatchEnv([robot.simulation], [robot.task], 1, seed=1)
    np.testing.assert_array_equal(env.reset()[0], plain.reset()[0])


def test_a_limb_of_two_joints_gives_all_its_angles_or_none() -> None:
    full = ARM.tokens
    own = [sensor for sensor in full.sensors if sensor.limb == "shoulder" and sensor.quantity == "angle"]
    assert len(own) == 2
    one = replace(full, sensors=tuple(sensor for sensor in full.sensors if sensor != own[0]))
    with pytest.raises(ConfigError, match="all or none"):
        sensor_columns(one, full)
    none = replace(full, sensors=tuple(sensor for sensor in full.sensors if sensor not in own))
    np.testing.assert_array_equal(sensor_columns(none, full), [s.index for s in full.sensors if s not in own])


def test_specifications_of_other_robots_and_orders_are_refused() -> None:
    with pytest.raises(ConfigError, match="other actuators"):
        BatchEnv([CHEETAH], [prepare(load("cheetah")).task], 1, specs=[ARM.tokens])
    turned = replace(CHEETAH.tokens, sensors=CHEETAH.tokens.sensors[::-1])
    with pytest.raises(ConfigError, match="another order"):
        sensor_columns(turned, CHEETAH.tokens)
    larger = token_spec(build_simulation(load("cheetah_4_back")).morphology)
    with pytest.raises(ConfigError, match="there are 0 tokens like 'bshin_position_x'"):
        sensor_columns(replace(larger, actuators=CHEETAH.tokens.actuators), CHEETAH.tokens)


def test_the_command_leaves_out_what_was_not_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tokens", "cheetah", "--sensors", "no_ltv", "--format", "csv"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 1 + 7 * 15 + 6
    assert not any(",type," in row for row in rows)
    assert run(["tokens", "cheetah", "--sensors", "position,translational_velocity", "--format", "csv"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1 + 7 * 6 + 6
    for option in ("--sensors", "--quantity"):
        assert run(["tokens", "cheetah", option, "positon"]) == 2
        assert "did you mean 'position'" in capsys.readouterr().err
