"""Return on one body after equal processor time on one core, beside other people's learners in the same run.

The learners are the default preset, CrossQ and TD3 of SBX (Bhatt et al. 2024; JAX) and TD3 of Stable-Baselines3
(PyTorch), each with its library's defaults, on the same environment. Every learner is a process with one thread on a
core of its own, and stops after so many minutes of its own processor time, compilation included: other work on the
machine makes the run longer but changes nothing else. Returns are means of noise-free episodes.

    pip install -e '.[peers]'
    python tools/peers.py [--robots walker_7_main hopper_5] [--minutes 10] [--seeds 0 1 2] [--learners NAME ...]
        [--episodes 10] [--cores 2] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

LEARNERS = ("morphkit", "sbx-crossq", "sbx-td3", "sb3-td3")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", default=["walker_7_main", "hopper_5"])
    parser.add_argument("--minutes", type=float, default=10.0, help="processor time of each learner")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--learners", nargs="+", choices=LEARNERS, default=list(LEARNERS))
    parser.add_argument("--episodes", type=int, default=10, help="of the final evaluation")
    parser.add_argument("--cores", type=int, default=len(os.sched_getaffinity(0)), help="learners at once")
    parser.add_argument("--set", nargs="+", default=[], help="settings of the default preset")
    parser.add_argument("--json", action="store_true", help="print one JSON object a learner")
    parser.add_argument("--one", nargs=3, metavar=("ROBOT", "LEARNER", "SEED"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        robot, learner, seed = options.one
        print(json.dumps(learn(robot, learner, int(seed), options)))
        return
    for row in side_by_side(options):
        print(
            json.dumps(row)
            if options.json
            else f"{row['robot']:<16} seed {row['seed']}  {row['learner']:<11} return {row['return']:8.0f}  "
            f"{row['steps']:>8} steps {row['updates']:>8} updates  {row['processor_min']:5.1f} processor min",
            flush=True,
        )


def side_by_side(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Results of all learners as they come, so many at once as there are cores."""
    waiting = [
        (robot, learner, str(seed))
        for robot in options.robots
        for seed in options.seeds
        for learner in options.learners
    ]
    results: queue.Queue[dict[str, Any] | BaseException] = queue.Queue()
    total, cores = len(waiting), sorted(os.sched_getaffinity(0))[: options.cores]

    def work(core: int) -> None:
        while waiting:
            try:
                results.put(_process(waiting.pop(0), core, options))
            except BaseException as error:
                results.put(error)

    for core in cores:
        threading.Thread(target=work, args=(core,), daemon=True).start()
    for _ in range(total):
        result = results.get()
        if isinstance(result, BaseException):
            raise result
        yield result


def _process(one: tuple[str, str, str], core: int, options: argparse.Namespace) -> dict[str, Any]:
    """A learner in a process with one thread on one core."""
    command = [sys.executable, __file__, "--minutes", str(options.minutes), "--episodes", str(options.episodes)]
    command += [*(["--set", *options.set] if options.set else []), "--one", *one]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    xla = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        ["taskset", "-c", str(core), *command], env=os.environ | threads | xla, stdout=subprocess.PIPE, check=True
    )
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def learn(robot: str, learner: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Train one learner and evaluate it without noise."""
    deadline = time.process_time() + 60 * options.minutes
    train = _own if learner == "morphkit" else _peer
    act, counts = train(robot, learner, seed, deadline, options)
    spent = options.minutes + (time.process_time() - deadline) / 60
    returns = _returns(robot, act, options.episodes)
    return {
        "robot": robot, "learner": learner, "seed": seed, "return": sum(returns) / len(returns), "returns": returns,
        **counts, "processor_min": spent,
    }  # fmt: skip


Act = Callable[[Any], Any]
"""Observation (tokens,) -> action (actuators,), both as the environment has them."""


def _own(
    robot: str, learner: str, seed: int, deadline: float, options: argparse.Namespace
) -> tuple[Act, dict[str, int]]:
    import morphkit
    import morphkit_rl
    from morphkit_rl.training.progress import Progress

    def stop_in_time(progress: Progress) -> None:
        if time.process_time() >= deadline:
            signal.raise_signal(signal.SIGINT)

    with tempfile.TemporaryDirectory() as folder:
        run, config = Path(folder) / "run", morphkit_rl.load_config("default", options.set)
        body = morphkit.load(robot)
        summary = morphkit_rl.train([body], run, config, seed=seed, minutes=1e6, progress=stop_in_time)
        policy = morphkit_rl.Policy.load(run)
    spec = morphkit_rl.prepare(body, config.text.naming).spec

    return lambda obs: policy.act(spec, obs), {"steps": summary.steps, "updates": summary.updates}


def _peer(
    robot: str, learner: str, seed: int, deadline: float, options: argparse.Namespace
) -> tuple[Act, dict[str, int]]:
    import gymnasium
    import sbx
    import stable_baselines3
    from stable_baselines3.common.callbacks import BaseCallback

    import morphkit_rl  # noqa: F401  registers the environments

    class InTime(BaseCallback):
        def _on_step(self) -> bool:
            return time.process_time() < deadline

    algorithm = {"sbx-crossq": sbx.CrossQ, "sbx-td3": sbx.TD3, "sb3-td3": stable_baselines3.TD3}[learner]
    model = algorithm("MlpPolicy", gymnasium.make(f"morphkit/{robot}-v0"), seed=seed)
    model.learn(10**9, callback=InTime())

    return lambda obs: model.predict(obs, deterministic=True)[0], {
        "steps": int(model.num_timesteps),
        "updates": int(model._n_updates),
    }


def _returns(robot: str, act: Act, episodes: int) -> list[float]:
    import gymnasium

    import morphkit_rl  # noqa: F401  registers the environments

    env = gymnasium.make(f"morphkit/{robot}-v0")
    returns = []
    for number in range(episodes):
        obs, _ = env.reset(seed=10_000 + number)
        total, over = 0.0, False
        while not over:
            obs, reward, terminated, truncated, _ = env.step(act(obs))
            total, over = total + float(reward), terminated or truncated
        returns.append(total)
    return returns


if __name__ == "__main__":
    main()
