"""Networks whose text embeddings learn with them."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from morphkit_rl.models.layout import Layout


class _Tuned(nn.Module):
    """A network behind embeddings of its own.

    Args:
        network: Actor or critics.
        embeddings: Layout to embeddings (texts, size).
    """

    def __init__(self, network: Any, embeddings: nn.Module):
        super().__init__()
        self.network, self.embeddings = network, embeddings

    @property
    def last_layers(self) -> tuple[str, ...]:
        """Prefixes of the parameters that a reset draws anew."""
        return tuple(f"network.{prefix}" for prefix in self.network.last_layers)

    def tuned(self, layout: Layout) -> Layout:
        """The layout with embeddings as they are now."""
        return layout.with_embeddings(self.embeddings(layout))


class TunedActor(_Tuned):
    """(batch, tokens) -> (batch, actions) in [-1, 1]."""

    def read_names(self, layout: Layout) -> Any:
        """Do what depends on the layout's names only."""
        return self.network.read_names(self.tuned(layout))

    def forward(self, obs: Tensor, layout: Layout, names: Any = None) -> Tensor:
        """Act on observation rows; `names`, from `read_names`, saves time while the weights stay."""
        return self.network(obs, layout, self.read_names(layout) if names is None else names)


class TunedCritic(_Tuned):
    """Twin values: (batch, tokens), (batch, actions) -> (members, batch, values)."""

    def value_robot(self, layout: Layout) -> Tensor:
        """(values,) robot of each value."""
        return self.network.value_robot(layout)

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at observation rows, by the first `members` critics."""
        return self.network(obs, action, self.tuned(layout), members)
