"""What tokens are called: the scalars of a limb, and the labels of limbs, joints and actuators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from morphkit.morphology import Actuator, Joint, Limb, Morphology
from morphkit.naming.limbs import canonical_joint_names, canonical_limb_names, numbered_labels
from morphkit.naming.plain import plain_words
from morphkit.naming.unique import unique
from morphkit.naming.vocabulary import split
from morphkit.tokens import quantities

Naming = Literal["raw", "canonical"]
LimbNames = Literal["body", "joint"]
TextStyle = Literal["words", "raw"]


class LimbScalar(NamedTuple):
    """One scalar that a limb senses.

    Attributes:
        limb: Name of the limb.
        suffix: What the token's name ends in.
        quantity: What is sensed.
        component: Which scalar of it; None where there is one.
        unit: Its unit.
        frame: The frame that it is seen from.
        limit: What it is clipped to, plus and minus.
    """

    limb: str
    suffix: str
    quantity: str
    component: str | None
    unit: str
    frame: str | None
    limit: float | None


def limb_scalars(limb: Limb, labels: Mapping[str, str]) -> Iterator[LimbScalar]:
    """The scalars of a limb in their order; `labels` says what its joints are called."""
    for each in quantities.LIMB_QUANTITIES:
        for part in each.components:
            yield LimbScalar(limb.name, f"{each.name}_{part}", each.name, part, each.unit, each.frame, each.limit)
    joints: tuple[Joint | None, ...] = limb.joints or (None,)
    for joint in joints:
        start = f"{labels[joint.name]}_" if joint and len(limb.joints) > 1 else ""
        unit = "m" if joint is not None and joint.kind == "slide" else "1"
        for quantity in quantities.JOINT_QUANTITIES:
            yield LimbScalar(limb.name, start + quantity, quantity, None, unit, None, None)


def limb_labels(
    morphology: Morphology, naming: Naming, limb_names: str, canonical: Mapping[str, str]
) -> dict[str, str]:
    """What each limb is called in token names, by its name in the file."""
    if limb_names == "body" and naming == "canonical":
        return {limb: _underscored(name) for limb, name in canonical_limb_names(morphology, canonical).items()}
    if limb_names == "body":
        names = [limb.name for limb in morphology.limbs]
        return dict(zip(names, names, strict=True)) | numbered_labels(names, morphology.labels)
    said = limb_words(morphology, naming, canonical)
    labels = unique(label_alone(limb, naming, limb_names, said) for limb in morphology.limbs)
    return dict(zip((limb.name for limb in morphology.limbs), labels, strict=True))


def limb_words(morphology: Morphology, naming: Naming, canonical: Mapping[str, str]) -> dict[str, str]:
    """The canonical name of each limb, by which codes in the names of what is on it are read; none with raw names."""
    return canonical_limb_names(morphology, canonical) if naming == "canonical" else {}


def label_alone(limb: Limb, naming: Naming, limb_names: str, words: Mapping[str, str]) -> str:
    """What `limb` would be called in token names if there were no other; `words` are its `limb_words`."""
    label = limb.joints[0].name if limb_names == "joint" and limb.joints and limb.parent is not None else limb.name
    return _plain(label, words.get(limb.name, "")) if naming == "canonical" else label


def joint_labels(limb: Limb, naming: Naming, label: str) -> dict[str, str]:
    """What each joint of a limb that is called `label` is called in token names, by its name in the file."""
    if naming == "canonical":
        return {joint: _underscored(name) for joint, name in canonical_joint_names(limb, label).items()}
    return {joint.name: joint.name for joint in limb.joints}


def actuator_names(
    actuators: tuple[Actuator, ...],
    naming: Naming,
    labels: Mapping[str, str],
    joints: Mapping[str, Mapping[str, str]],
) -> Iterator[str]:
    """`<limb>_ctrl`; `<limb>_<joint>_ctrl` where a limb has several; the actuator's own name where that is no name."""
    a_limb = Counter(actuator.limb for actuator in actuators)
    a_joint = Counter((actuator.limb, actuator.joint) for actuator in actuators)
    for actuator in actuators:
        limb, joint = actuator.limb, actuator.joint
        own = _plain(actuator.name, labels.get(limb or "", "")) if naming == "canonical" else actuator.name
        if limb is None:
            parts = [own]
        elif a_limb[limb] == 1:
            parts = [labels[limb]]
        elif joint is not None and a_joint[limb, joint] == 1:
            parts = [labels[limb], joints[limb].get(joint, joint)]
        else:
            parts = [labels[limb], own]
        yield "_".join([*parts, "ctrl"])


def numbered_controls(actuators: Sequence[Actuator], alone: Sequence[str], taken: Iterable[str]) -> list[str]:
    """Names of the actuators' tokens, unique also among those `taken`, out of what each would be called `alone`.

    Those that drive a limb come first: one that drives none never takes a limb's name.
    """
    order = sorted(range(len(actuators)), key=lambda index: actuators[index].limb is None)
    names = dict(zip(order, unique((alone[index] for index in order), taken=taken), strict=True))
    return [names[index] for index in range(len(actuators))]


def _plain(name: str, limb: str) -> str:
    """The name, in plain words, of what is on a limb of that name; both with underscores between words."""
    return _underscored(plain_words(split(name), said=limb.replace("_", " ").split()))


def _underscored(name: str) -> str:
    return name.replace(" ", "_")
