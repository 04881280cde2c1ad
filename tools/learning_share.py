"""How much of a run's processor time is learning, for one robot, four and fourteen: parts of the quadruped.

Each run has the default preset, as `morphkit train` would give it. After the first updates, sweeps are timed on one
thread of the learner, by processor time, so that other work on the machine matters little.

    OMP_NUM_THREADS=1 python tools/learning_share.py [--bodies 1 4 14] [--sweeps 5] [--set SECTION.NAME=VALUE]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import torch

from morphkit.description import Description
from morphkit.families.enumeration import sub_morphologies
from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.kernels import library
from morphkit_rl.runs.run_settings import RunSettings
from morphkit_rl.training.session import Session

ROBOT = "quadruped"
OPTIONS = ("trainer.sensors=proprioceptive", "trainer.start_steps=256")
WARM_UP = 32
"""Updates before anything is timed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", type=int, default=[1, 4, 14], help="numbers of robots")
    parser.add_argument("--sweeps", type=int, default=5, help="sweeps that are timed")
    parser.add_argument("--set", nargs="+", default=[], help="settings besides those of the default preset")
    options = parser.parse_args()
    torch.set_num_threads(1)
    library.prepare().join()
    print("| robots | environments a robot | steps a sweep | ms a sweep | learning | samples/s | steps/s |")
    print("|---|---|---|---|---|---|---|")
    for number in options.bodies:
        print(measure(number, load_config(overrides=[*OPTIONS, *options.set]).for_robots(number), options.sweeps))


def measure(number: int, config: TrainConfig, sweeps: int) -> str:
    """A row of the table."""
    session = Session(
        RunSettings(
            bodies(number), (), (), config, None, None, seed=0, minutes=None, steps=10**6, device="cpu", threads=1
        )
    )
    agent, learning = session.agent, [0.0]
    update = agent.update

    def timed(*arguments: Any) -> dict[str, torch.Tensor]:
        start = time.process_time()
        losses = update(*arguments)
        learning[0] += time.process_time() - start
        return losses

    agent.update = timed  # type: ignore[method-assign]
    while agent.learner.updates < WARM_UP:
        session.schedule.advance()
    learning[0], updates, start = 0.0, agent.learner.updates, time.process_time()
    for _ in range(sweeps):
        session.schedule.advance()
    seconds = time.process_time() - start
    session.close()
    steps = config.trainer.num_envs * number
    samples = (agent.learner.updates - updates) * number * -(-config.td3.batch_size // number)
    return (
        f"| {number} | {config.trainer.num_envs} | {steps} | {1000 * seconds / sweeps:.0f} |"
        f" {100 * learning[0] / seconds:.0f} % | {samples / seconds:.0f} | {sweeps * steps / seconds:.0f} |"
    )


def bodies(number: int) -> tuple[Description, ...]:
    """The quadruped, or so many parts of it."""
    whole = load(ROBOT)
    return (whole,) if number == 1 else tuple(each.description for each in sub_morphologies(whole, limit=number))


if __name__ == "__main__":
    main()
