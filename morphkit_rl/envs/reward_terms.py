"""Terms that a task's reward is made of, by name.

A term is a function of a robot's `RobotArrays` that gives one number an environment, (n,). Its keyword arguments are
settings, numbers with defaults. Most are from Rudin et al. 2022, Learning to Walk in Minutes Using Massively Parallel
Deep Reinforcement Learning, table 2.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.utils.suggest import did_you_mean_or_list
from morphkit_rl.envs.robot_arrays import RobotArrays
from morphkit_rl.envs.task_settings import Term

RewardTerm = Callable[..., np.ndarray]
TERMS: dict[str, RewardTerm] = {}


def reward_term(function: RewardTerm) -> RewardTerm:
    """Make a function a term that tasks can name.

    >>> @reward_term
    ... def low(robot, *, share=0.8):
    ...     return (robot.height < share).astype(float)

    Raises:
        ConfigError: Its name is taken by a term of morphkit, or an argument but the first has no number for a default.
    """
    name = function.__name__
    known = TERMS.get(name)
    if known is not None and known.__module__ == __name__:
        raise ConfigError(f"{name!r} is a term of morphkit already; give the function another name")
    settings_of(function)
    TERMS[name] = function
    return function


def settings_of(function: RewardTerm) -> dict[str, float]:
    """Settings of a term with their defaults."""
    found = {}
    for argument in list(inspect.signature(function).parameters.values())[1:]:
        if isinstance(argument.default, bool) or not isinstance(argument.default, int | float):
            raise ConfigError(f"term {function.__name__!r}: argument {argument.name!r} needs a number as its default")
        found[argument.name] = float(argument.default)
    return found


def read_term(name: str, value: Any, origin: str) -> Term:
    """A term from its weight, or from a table with `weight` and settings.

    Raises:
        UnknownNameError: There is no such term.
        ConfigError: The weight is missing, a setting does not exist, or something is no finite number.
    """
    if name not in TERMS:
        raise UnknownNameError(f"{origin}: there is no term {name!r}{did_you_mean_or_list(name, TERMS)}")
    table = dict(value) if isinstance(value, Mapping) else {"weight": value}
    known = settings_of(TERMS[name])
    for key, number in table.items():
        if key != "weight" and key not in known:
            raise ConfigError(
                f"{origin}: terms.{name} has no setting {key!r}{did_you_mean_or_list(key, ['weight', *known])}"
            )
        if isinstance(number, bool) or not isinstance(number, int | float) or not np.isfinite(number):
            raise ConfigError(f"{origin}: terms.{name}.{key} is {number!r}; expected a finite number")
    if "weight" not in table:
        raise ConfigError(f"{origin}: terms.{name} has no weight")
    weight = float(table.pop("weight"))
    return Term(name, weight, tuple((key, float(number)) for key, number in table.items()))


@reward_term
def alive(robot: RobotArrays) -> np.ndarray:
    """1 where the robot has not fallen."""
    return 1.0 - robot.ended


@reward_term
def fall(robot: RobotArrays) -> np.ndarray:
    """1 where the robot fell in this step."""
    return robot.ended.astype(float)


@reward_term
def forward_velocity(robot: RobotArrays, *, limit: float = 1e6) -> np.ndarray:
    """Speed in the direction that the robot heads, m/s, no more than `limit`."""
    return np.minimum(robot.velocity[:, 0], limit)


@reward_term
def progress(robot: RobotArrays) -> np.ndarray:
    """Share of the commanded velocity that the robot moves with, in its direction, from -1 to 1; 0 without any."""
    wanted = robot.command[:, :2]
    square = (wanted**2).sum(1)
    along = (robot.velocity[:, :2] * wanted).sum(1)
    return np.divide(along, square, out=np.zeros_like(along), where=square > 1e-6).clip(-1, 1)


@reward_term
def track_velocity(robot: RobotArrays, *, sigma: float = 0.0625) -> np.ndarray:
    """exp(-|error|^2 / sigma) of the horizontal velocity, the error in units of the command's speeds."""
    error = (robot.velocity[:, :2] - robot.command[:, :2]) / robot.speed_unit
    return np.exp(-(error**2).sum(1) / sigma)


@reward_term
def track_yaw(robot: RobotArrays, *, sigma: float = 0.25) -> np.ndarray:
    """exp(-error^2 / sigma) of the turning speed, rad/s."""
    return np.exp(-((robot.yaw_rate - robot.command[:, 2]) ** 2) / sigma)


@reward_term
def track_command(robot: RobotArrays, *, sigma: float = 0.0625, yaw_sigma: float = 0.25) -> np.ndarray:
    """Product of `track_velocity` and `track_yaw`: turning right alone earns nothing."""
    return track_velocity(robot, sigma=sigma) * track_yaw(robot, sigma=yaw_sigma)


@reward_term
def upright(robot: RobotArrays) -> np.ndarray:
    """Cosine of the tilt."""
    return -robot.gravity[:, 2]


@reward_term
def tilt(robot: RobotArrays) -> np.ndarray:
    """Square of the sine of the tilt."""
    return (robot.gravity[:, :2] ** 2).sum(1)


@reward_term
def height(robot: RobotArrays, *, share: float = 1.0, sigma: float = 0.04) -> np.ndarray:
    """exp(-error^2 / sigma) of the root's height as a share of that at the start."""
    return np.exp(-((robot.height - share) ** 2) / sigma)


@reward_term
def bouncing(robot: RobotArrays) -> np.ndarray:
    """Square of the vertical speed, (m/s)^2."""
    return robot.velocity[:, 2] ** 2


@reward_term
def rocking(robot: RobotArrays) -> np.ndarray:
    """Square of the speed of rolling and pitching, (rad/s)^2."""
    return (robot.rotational_velocity[:, :2] ** 2).sum(1)


@reward_term
def posture(robot: RobotArrays) -> np.ndarray:
    """Mean square of how far joints are from the start pose, rad^2 (m^2)."""
    return _mean((robot.joint_position - robot.joint_start) ** 2)


@reward_term
def joint_speed(robot: RobotArrays) -> np.ndarray:
    """Mean square of the speed of joints, (rad/s)^2 ((m/s)^2)."""
    return _mean(robot.joint_velocity**2)


@reward_term
def joint_limits(robot: RobotArrays, *, margin: float = 0.05) -> np.ndarray:
    """Mean distance of joints beyond their limits or closer than `margin` to them, rad (m)."""
    low = robot.joint_low + margin - robot.joint_position
    high = robot.joint_position - robot.joint_high + margin
    return _mean(np.maximum(np.maximum(low, high), 0.0))


@reward_term
def action_rate(robot: RobotArrays) -> np.ndarray:
    """Mean square of how much actions changed, as shares of half the actuators' ranges."""
    return _mean((robot.action - robot.previous_action) ** 2)


@reward_term
def control(robot: RobotArrays) -> np.ndarray:
    """Mean square of actions, as shares of half the actuators' ranges."""
    return _mean(robot.action**2)


@reward_term
def energy(robot: RobotArrays) -> np.ndarray:
    """Mechanical power that joints give or take, over the robot's weight, m/s."""
    return np.abs(robot.power).sum(1) / robot.weight


@reward_term
def foot_slip(robot: RobotArrays) -> np.ndarray:
    """Sum of the squares of the horizontal speeds of feet that touch the floor, (m/s)^2."""
    speed = (robot.foot_velocity[..., :2] ** 2).sum(-1)
    return (speed * robot.foot_contact).sum(1)


@reward_term
def feet_air_time(robot: RobotArrays, *, least: float = 0.2, most: float = 0.5) -> np.ndarray:
    """Sum, over feet that land in this step, of how long they were off the floor, up to `most`, less `least`, s.

    Nothing where the robot is told to stand.
    """
    told = (np.abs(robot.command) > 1e-3).any(1)
    return ((np.minimum(robot.air_time, most) - least) * robot.foot_landed).sum(1) * told


@reward_term
def reach(robot: RobotArrays, *, sigma: float = 0.01) -> np.ndarray:
    """exp(-distance^2 / sigma) of the tip from its target, m."""
    return np.exp(-(robot.to_target**2).sum(1) / sigma)


@reward_term
def distance(robot: RobotArrays) -> np.ndarray:
    """Distance of the tip from its target, m."""
    return np.linalg.norm(robot.to_target, axis=1)


def _mean(values: np.ndarray) -> np.ndarray:
    """Over the columns; 0 where there are none."""
    return values.mean(1) if values.shape[1] else np.zeros(len(values))
