"""Settings of what the actor is shown besides the robots as they are."""

from __future__ import annotations

from dataclasses import dataclass

from morphkit_rl.config.parsing import bounded


@dataclass(frozen=True, slots=True)
class AugmentConfig:
    """How an update of the actor changes what the actor is shown, so that it does not rely on what new bodies lack.

    Actions are valued by the critics on the robots as they are, and collected without any of this.

    Attributes:
        mirror: Whether half of the updates show the mirror images of robots on a planar base: left is called right, and
            components across the plane change their sign. Motion in a plane is the same in its mirror image.
        limb_dropout: Probability that a limb is hidden from all other limbs.
        name_noise: Standard deviation of noise on the components of a text's embedding; theirs is about 1.
        name_dropout: Probability that a text reads like the mean of all texts.
        mirror_unseen: Whether a policy, once it is trained, acts for a robot on a planar base as for its mirror image,
            where that has more texts in common with a body of training than the robot. Updates do not change.
        rest_unseen: Whether limbs none of whose texts training had rest, and the others act as if these were not there,
            once a policy is trained. A robot of which no limb with an actuator is known is acted for as a whole.
    """

    mirror: bool = False
    limb_dropout: float = bounded(0.0, at_most=1)
    name_noise: float = 0.0
    name_dropout: float = bounded(0.0, at_most=1)
    mirror_unseen: bool = False
    rest_unseen: bool = False

    @property
    def in_updates(self) -> bool:
        """Whether updates show the actor anything else."""
        return self.mirror or self.limb_dropout > 0 or self.name_noise > 0 or self.name_dropout > 0
