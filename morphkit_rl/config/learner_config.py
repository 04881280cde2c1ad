"""Settings of the learner: critics, their loss, what rewards are divided by, step sizes and exploration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from morphkit_rl.config.parsing import bounded


@dataclass(frozen=True, slots=True)
class CriticSizes:
    """What the arrays of perceptron critics depend on; as in `LearnerConfig`."""

    critic_width: int
    critic_layers: int
    atoms: int


@dataclass(frozen=True, slots=True)
class LearnerConfig:
    """What a run may change about TD3; the defaults are TD3 as published, with the critics of the policy's method.

    Attributes:
        critic: `method`: the critics that come with the policy's method; `perceptron`: perceptrons that know tokens and
            robots by learned vectors.
        critic_width: Width of the hidden layers of perceptron critics.
        critic_layers: Their hidden layers after the first.
        value: `scalar` values and squared errors, or `categorical` distributions and cross-entropy; the latter needs
            perceptron critics.
        atoms: Atoms of a categorical value.
        support: Largest categorical value; the least is its negative.
        actor_objective: Whether the actor climbs the `first` critic, as published, or the `mean` of both.
        normalize_returns: Whether each robot's rewards are divided by max(standard deviation of its running discounted
            returns, largest of their absolute values / `support`).
        critic_learning_rate: Adam's step size for the critics; 0 for that of the actor, `td3.learning_rate`.
        final_learning_rate: Share of the step sizes that is left when the budget is used up; they fall linearly.
        final_discount: What `td3.discount` has become after `discount_updates`; 1 - discount changes by a constant
            factor an update (Francois-Lavet et al. 2015, section 3). 0: it stays.
        discount_updates: Updates until then.
        noise_spread: Exploration noise differs from environment to environment of a robot, evenly from
            `td3.exploration_noise` minus this to plus this.
        actor_start: Updates of the critics before the first one of the actor, for an actor that is good already.
        actor_average: Share of the last average of actor weights that an update keeps. The average is what evaluations
            and the saved policy act with. 0 for the weights themselves.
        saturation_margin: |atanh(action)| up to which `td3.saturation_penalty` does not count; 2 is an action of 0.96.
        sample_ahead: Whether a sweep's batches are drawn from the replay at once, which is cheaper.
    """

    critic: Literal["method", "perceptron"] = "method"
    critic_width: int = bounded(256, at_least=1)
    critic_layers: int = bounded(2, at_least=1)
    value: Literal["scalar", "categorical"] = "scalar"
    atoms: int = 101
    support: float = 5.0
    actor_objective: Literal["first", "mean"] = "first"
    normalize_returns: bool = False
    critic_learning_rate: float = 0.0
    final_learning_rate: float = bounded(1.0, at_most=1)
    final_discount: float = bounded(0.0, at_most=1)
    discount_updates: int = bounded(60_000, at_least=1)
    noise_spread: float = 0.0
    actor_start: int = 0
    actor_average: float = bounded(0.0, at_most=1)
    saturation_margin: float = 0.0
    sample_ahead: bool = False

    def sizes(self) -> CriticSizes:
        """Sizes of perceptron critics."""
        return CriticSizes(self.critic_width, self.critic_layers, self.atoms)
