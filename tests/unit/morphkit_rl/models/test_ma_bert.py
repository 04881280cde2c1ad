"""MA-BERT's options against the formulas written out."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from morphkit_rl.models.token_transformer import frequency_code
from tests.support.networks import layout_of, networks, rows, small


def test_the_frequency_code_is_sines_then_cosines() -> None:
    values = torch.tensor([[0.0, 0.25, -1.5]])
    code = frequency_code(values, 6)
    expected = [
        [
            *(math.sin(1000 * v * 10_000 ** (-2 * j / 6)) for j in range(3)),
            *(math.cos(1000 * v * 10_000 ** (-2 * j / 6)) for j in range(3)),
        ]
        for v in values[0].tolist()
    ]
    np.testing.assert_allclose(code[0], expected, atol=2e-4)  # float32 angles of up to 1500


@pytest.mark.parametrize("combine", ["concat", "add"])
@pytest.mark.parametrize("hidden", [False, True])
def test_embedding_and_code_meet_as_the_option_says(
    combine: str, hidden: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor, _ = networks(small("ma-bert", combine=combine, hidden=hidden))
    layout = layout_of("ma-bert", "hopper_3")
    obs, _ = rows(layout)
    embeddings = layout.embeddings[layout.token_text].expand(len(obs), -1, -1)
    code = math.sqrt(2) * frequency_code(obs, embeddings.shape[-1] if combine == "add" else 6)
    name = actor.read_name
    if combine == "add":
        x = (embeddings + code) @ name.weight[0] + name.bias[0, 0]
    else:
        weight = torch.cat([name.weight[0], actor.read_code.weight[0]])
        x = torch.cat([embeddings, code], -1) @ weight + name.bias[0, 0]
    if hidden:
        x = torch.relu(x) @ actor.hidden.weight[0] + actor.hidden.bias[0, 0]
    expected = torch.nn.functional.layer_norm(x, (16,))
    seen = []
    monkeypatch.setattr(actor.encoder, "forward", lambda tokens, spans: seen.append(tokens) or tokens)
    actor(obs, layout)
    torch.testing.assert_close(seen[0][0], expected, atol=1e-5, rtol=1e-5)
