"""Time of `Policy.act` for one observation, with the default preset's networks on the cheetah.

Run with `make bench` or `python tools/policy_speed.py`. Exits with 1 where the median misses the limit.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import torch

from morphkit.registry import load
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.train_config import load_config
from morphkit_rl.models import build
from morphkit_rl.runs import run_settings
from morphkit_rl.text.embedder import TokenEmbedder

CALLS = 2000
LIMIT_MS = 1.0


def main() -> int:
    torch.set_num_threads(1)
    config = load_config()
    robot = run_settings.prepare_robot(config, load("cheetah"))
    source = run_settings.make_encoder(config)
    embedder = TokenEmbedder.fit(source, robot.spec.texts, components=config.text.components)
    actor, _ = build(config.model, embedder.size)
    normalizer = Normalizer()
    normalizer.index([robot.spec], grow=True)
    policy = Policy(actor, normalizer, embedder, config)
    rows = np.random.default_rng(0).standard_normal((CALLS, len(robot.spec.sensors))).astype(np.float32)
    policy.act(robot.spec, rows[0])
    times = []
    for row in rows:
        start = time.perf_counter()
        policy.act(robot.spec, row)
        times.append(1000 * (time.perf_counter() - start))
    median, high = np.percentile(times, [50, 90])
    print(f"Policy.act, one observation: median {median:.3f} ms, 90 % below {high:.3f} ms (limit {LIMIT_MS:g} ms)")
    return int(median > LIMIT_MS)


if __name__ == "__main__":
    sys.exit(main())
