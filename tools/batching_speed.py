"""Updates a second of the default preset with all robots in one row, compared with one robot after another.

12 cheetah bodies, the preset's own batch size. The yardstick gives every robot its share of the batch in an update of
its own, in the order that the published code uses, and twelve of them count as one. The two take turns; medians are
printed.

    python tools/batching_speed.py [--repeats 5] [--preset default] [--json]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

import numpy as np
import torch

from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.algorithms.td3 import TD3, resolve_precision
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.train_config import load_config
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import run_settings
from morphkit_rl.text.embedder import TokenEmbedder

BODIES = (
    *("cheetah_2_back", "cheetah_2_front", "cheetah_3_back", "cheetah_3_front", "cheetah_4_allback"),
    *("cheetah_4_allfront", "cheetah_4_back", "cheetah_4_front", "cheetah_5_balanced", "cheetah_5_front"),
    *("cheetah_6_back", "cheetah_7_full"),
)
UPDATES = 12


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()

    config = load_config(arguments.preset)
    specs = [_spec(name, config.text.naming) for name in BODIES]
    texts = [text for spec in specs for text in spec.texts]
    embedder = TokenEmbedder.fit(run_settings.make_encoder(config), texts, components=config.text.components)
    precision = resolve_precision(config.trainer.precision, "cpu")
    share = -(-config.td3.batch_size // len(specs))
    together = [build_layout(specs, embedder)]
    one_by_one = [build_layout([spec], embedder) for spec in specs]
    rates: dict[str, list[float]] = {"all robots in one row": [], "one robot after another": []}
    for turn in range(arguments.repeats + 1):
        for measured, layouts in zip(rates.values(), (together, one_by_one), strict=True):
            torch.manual_seed(0)
            learner = TD3(
                config.model, config.td3, embedder.size,
                learner=config.learner, vocabulary=Vocabulary.of(specs), precision=precision,
            )  # fmt: skip
            batches = [_batch(layout, share) for layout in layouts]
            rng = np.random.default_rng(0)
            start = time.perf_counter()
            for _ in range(UPDATES):
                for layout, batch in zip(layouts, batches, strict=True):
                    ones, zeros = torch.ones(layout.num_tokens), torch.zeros(layout.num_tokens)
                    learner.update(batch, ones, zeros, layout, rng)
            if turn:  # the first turn warms up
                measured.append(UPDATES / (time.perf_counter() - start))
    medians = {name: statistics.median(measured) for name, measured in rates.items()}
    ratio = medians["all robots in one row"] / medians["one robot after another"]
    if arguments.json:
        print(
            json.dumps({"updates_per_s": medians, "ratio": ratio, "batch": share * len(specs), "precision": precision})
        )
        return
    print(
        f"updates of preset {arguments.preset}: {len(specs)} bodies, batch {share * len(specs)}, {precision}, "
        f"{torch.get_num_threads()} threads"
    )
    for name, rate in medians.items():
        print(f"  {name:<26}{rate:8.1f} updates/s")
    print(f"  {'ratio':<26}{ratio:8.1f}")


def _spec(name: str, naming: str) -> TokenSpec:
    description = load(name)
    return token_spec(read(description), naming=naming, canonical=description.info.canonical)


def _batch(layout: Layout, size: int) -> Batch:
    rng = np.random.default_rng(0)
    obs, next_obs = rng.standard_normal((2, size, layout.num_tokens)).astype(np.float32)
    action = rng.uniform(-1, 1, (size, layout.num_actions)).astype(np.float32)
    reward, discount = rng.uniform(0, 1, (2, size, layout.num_robots)).astype(np.float32)
    return Batch(obs, action, reward, next_obs, discount)


if __name__ == "__main__":
    main()
