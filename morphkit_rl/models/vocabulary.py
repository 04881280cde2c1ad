"""What a method must know of the training robots before it can make its networks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.models.layout import limb_action, parent_indices


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """Names and greatest sizes among the training robots; saved with a checkpoint.

    Attributes:
        sensors: Sorted distinct names of the sensor tokens.
        actions: Sorted distinct names of the actions, one an actuator and one a limb without any.
        texts: Sorted distinct texts of both.
        scalars: Most scalars in a limb.
        children: Most children of a limb.
        robots: Names of the robots, in order.
        bodies: For each body of training, places in `texts` of those of its tokens.
        quantities: Sorted distinct quantities of the sensor tokens.
    """

    sensors: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    scalars: int = 0
    children: int = 0
    robots: tuple[str, ...] = ()
    bodies: tuple[tuple[int, ...], ...] = ()
    quantities: tuple[str, ...] = ()

    @classmethod
    def of(cls, specs: Sequence[TokenSpec]) -> Vocabulary:
        """The vocabulary of the robots `specs`."""
        sensors = {sensor.name for spec in specs for sensor in spec.sensors}
        actions = {actuator.name for spec in specs for actuator in spec.actuators}
        texts = {text for spec in specs for text in spec.texts}
        scalars = children = 0
        for spec in specs:
            driven, parents = set(spec.actuator_limb.tolist()), parent_indices(spec)
            token_limb = spec.token_limb.tolist()
            for limb in range(len(spec.limbs)):
                scalars = max(scalars, token_limb.count(limb))
                children = max(children, parents.count(limb))
                if limb not in driven:
                    name, text = limb_action(spec, limb)
                    actions.add(name)
                    texts.add(text)
        names = tuple(spec.morphology for spec in specs)
        ordered = tuple(sorted(texts))
        bodies = places([spec.texts for spec in specs], ordered)
        quantities = tuple(sorted({sensor.quantity for spec in specs for sensor in spec.sensors}))
        known = tuple(sorted(sensors)), tuple(sorted(actions)), ordered
        return cls(*known, scalars, children, names, bodies, quantities)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Vocabulary:
        """Read what `to_dict` gave, also after a journey through JSON."""
        sensors, actions, texts = (tuple(values[key]) for key in ("sensors", "actions", "texts"))
        robots, quantities = (tuple(values.get(key, ())) for key in ("robots", "quantities"))
        bodies = tuple(map(tuple, values.get("bodies", ())))
        return cls(sensors, actions, texts, values["scalars"], values["children"], robots, bodies, quantities)

    def texts_of_bodies(self) -> list[set[str]]:
        """Texts of the tokens of each body of training; none where a checkpoint does not say them."""
        return [{self.texts[place] for place in body} for body in self.bodies]

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON can hold them."""
        return asdict(self)


def places(bodies: Iterable[Iterable[str]], texts: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    """Where in `texts` those of each body are, each once, in order."""
    place = {text: number for number, text in enumerate(texts)}
    return tuple(tuple(sorted({place[text] for text in body})) for body in bodies)
