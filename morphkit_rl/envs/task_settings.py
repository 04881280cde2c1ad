"""What a task may say besides rewards: commands, starts, pushes, and what differs between environments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from morphkit_rl.config.parsing import bounded

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Term:
    """A term of a reward.

    Attributes:
        name: Name of a function in `reward_terms`.
        weight: What its value is multiplied by.
        settings: Its settings by name, those that are not its defaults.
    """

    name: str
    weight: float
    settings: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Commands:
    """Velocities that a robot is told to move with, drawn uniformly from ranges at the start of an episode.

    Attributes:
        x: Speed forward, in the direction that the robot heads, m/s.
        y: Speed to the left, m/s.
        yaw: Speed of turning left, rad/s.
        heading: Speed of turning back to the direction that the robot headed in its start pose, rad/s for each radian
            that it heads off, 1 rad/s at most, in place of `yaw`; 0 for `yaw` (Rudin et al. 2022, section 3).
        seconds: Time after which they are drawn anew; 0 for never within an episode.
        froude: Whether speeds are in units of sqrt(g * h), with h the height at which the robot starts, in place of
            m/s: animals of any size change gaits at like shares (Alexander 1989, Optimization and gaits in the
            locomotion of vertebrates).
    """

    x: Range = (0.0, 0.0)
    y: Range = (0.0, 0.0)
    yaw: Range = (0.0, 0.0)
    heading: float = bounded(0.0, at_most=100)
    seconds: float = 0.0
    froude: bool = False


@dataclass(frozen=True, slots=True)
class Start:
    """Noise of the start states, uniform within +- these.

    Attributes:
        pose: Of coordinates, m or rad.
        velocity: Of velocities, m/s or rad/s.
    """

    pose: float = 0.05
    velocity: float = 0.05


@dataclass(frozen=True, slots=True)
class Ends:
    """When an episode ends early.

    Attributes:
        height: Open interval of the root's height, as shares of that at the start, outside of which it ends.
        tilt: Angle between the vertical and the root's axis that was vertical at the start, rad, at which it ends.
    """

    height: Range = (0.0, 0.0)
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class Pushes:
    """Sudden horizontal velocities of the root.

    Attributes:
        seconds: Time between two; 0 for none.
        speed: Largest change along x and along y, m/s.
    """

    seconds: float = 0.0
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class Randomization:
    """Factors that are drawn uniformly from ranges for each episode.

    Attributes:
        friction: On sliding friction of all geoms.
        mass: On masses and inertias of the robot.
        gain: On gains of all actuators, those of servos' damping included.
    """

    friction: Range = (1.0, 1.0)
    mass: Range = (1.0, 1.0)
    gain: Range = (1.0, 1.0)

    @property
    def any(self) -> bool:
        """Whether anything differs."""
        return not self.friction == self.mass == self.gain == (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Task:
    """What a robot is rewarded for and when its episodes end.

    Reward of a step = `forward_weight` * forward speed + `alive_bonus` - `control_cost` * |a|^2
    + `tip_height_weight` * tip height. Forward speed is (x after - x before) / duration of the step, m/s, of the planar
    base's x slide or of a free root's frame.

    Attributes:
        name: Name of the task.
        frame_skip: Simulator steps in a control step; None: as many as come closest to `control_period`.
        control_period: Duration of a control step that is aimed for where `frame_skip` is None, s.
        episode_length: Control steps after which an episode is truncated.
        forward_weight: Weight of the forward speed.
        alive_bonus: Paid every step, the last included.
        control_cost: Weight of |a|^2.
        control_as_share: Whether |a|^2 takes each control as a share of its bound (largest of |low|, |high|), so that
            a 30 N*m motor costs no more than a normalized one; otherwise in its own unit.
        tip_height_weight: Weight of the height of the tip above the root's frame, as a share of its reach. The tip is
            the far end of the last limb of the deepest chain, twice as far from its frame as its center of mass.
        healthy_height: Open interval of the root's height, m, outside which the episode ends; None: no bounds. Measured
            at the z slide's coordinate of a planar base; at the root's frame above the world's origin for a free one
            and where `height_in_world`.
        healthy_share: The same as shares of the start height; `task_for` turns it into `healthy_height`. Where the
            root's frame starts at the ground, as a URDF's `base_footprint` does, or below it, the robot may sink and
            rise by shares of how high its center of mass lies above its lowest point.
        height_in_world: See `healthy_height`.
        healthy_pitch: The episode ends when |pitch| of a planar base, or the tilt of a free one, reaches this, rad.
            Tilt is the angle between world z and the root's axis that pointed along world z at the start.
        healthy_state: The episode ends when any |coordinate| or |velocity| but the first two coordinates reaches this.
        qpos_noise: Start coordinates are uniform within +- this around the model's start, m or rad; slides with limits
            stay within these.
        qvel_noise: Scale of the start velocities, m/s or rad/s.
        qvel_noise_kind: `uniform` within +-scale, or `normal` with that standard deviation.
        terms: More that a step is rewarded for, as in `reward_terms`.
        commands: Velocities that the robot is told; None for none.
        reach: Whether the tip has a target.
        reach_seconds: Time after which it is drawn anew, s; 0 for never within an episode.
        pushes: Sudden velocities.
        randomize: What differs between episodes.
        speed_unit: What terms count speeds in, m/s; `task_for` fills it in.
        source: The TOML that the task was read from, where it is none that ships.
    """

    name: str
    frame_skip: int | None = 4
    control_period: float = 0.02
    episode_length: int = 1000
    forward_weight: float = 1.0
    alive_bonus: float = 0.0
    control_cost: float = 0.0
    control_as_share: bool = False
    tip_height_weight: float = 0.0
    healthy_height: Range | None = None
    healthy_share: Range | None = None
    height_in_world: bool = False
    healthy_pitch: float | None = None
    healthy_state: float | None = None
    qpos_noise: float = 0.005
    qvel_noise: float = 0.005
    qvel_noise_kind: Literal["uniform", "normal"] = "uniform"
    terms: tuple[Term, ...] = ()
    commands: Commands | None = None
    reach: bool = False
    reach_seconds: float = 0.0
    pushes: Pushes = Pushes()
    randomize: Randomization = Randomization()
    speed_unit: float = 1.0
    source: str = ""

    @property
    def most(self) -> float:
        """Reward of a step in which every term with a positive weight is 1."""
        return sum(max(term.weight, 0.0) for term in self.terms)


@dataclass(frozen=True, slots=True)
class TaskFile:
    """What a task's TOML file says besides its terms.

    Attributes:
        control_period: Duration of a control step, s; as many simulator steps as come closest to it.
        episode_seconds: Duration after which an episode is truncated, s.
        reach: Whether the tip has a target, drawn for each episode: where random joint angles, of those that motors can
            bring it to, would put it.
        reach_seconds: Time after which the target is drawn anew, s; 0 for never within an episode.
        python: Files of Python code whose terms it uses, relative to its own folder.
        commands: Velocities that the robot is told.
        start: Noise of the start states.
        ends: When an episode ends early.
        pushes: Sudden velocities.
        randomize: What differs between episodes.
    """

    control_period: float = bounded(0.02, at_least=1e-4, at_most=10.0)
    episode_seconds: float = bounded(20.0, at_least=1e-3, at_most=1e6)
    reach: bool = False
    reach_seconds: float = 0.0
    python: tuple[str, ...] = ()
    commands: Commands = Commands()
    start: Start = Start()
    ends: Ends = Ends()
    pushes: Pushes = Pushes()
    randomize: Randomization = Randomization()
