"""From tasks, splits, methods and seeds to the cells of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

from morphkit.errors import ConfigError
from morphkit_rl.benchmark.bodies import gather_bodies
from morphkit_rl.benchmark.cells import Cell, MatrixPlan
from morphkit_rl.benchmark.definition import Benchmark
from morphkit_rl.benchmark.methods import method_config
from morphkit_rl.benchmark.published import published_steps
from morphkit_rl.config.methods import find_method
from morphkit_rl.runs.run_settings import prepare_robot

EPISODES = 10
"""Noise-free episodes a robot in the published protocol."""


def plan_matrix(
    benchmark: Benchmark,
    *,
    tasks: Sequence[str],
    splits: Sequence[str],
    methods: Sequence[str],
    seeds: int,
    steps: int | None = None,
    minutes: float | None = None,
    preset: str | None = None,
    overrides: Sequence[str] = (),
    episodes: int = EPISODES,
    validate: bool = False,
    cuts: int = 0,
) -> list[MatrixPlan]:
    """Plan every combination of tasks, splits, methods and seeds, the first seed of all of them first.

    Args:
        benchmark: Tasks and splits.
        tasks: Names of tasks.
        splits: Names of splits.
        methods: Names of methods or presets.
        seeds: How many seeds; 0 is the first.
        steps: Budget of counted steps of a cell; the published 3 million where neither `steps` nor `minutes` is given.
        minutes: Budget of training time of a cell.
        preset: Preset to take in place of the method's own; for a single method.
        overrides: Settings such as `td3.tau=0.01`, for all.
        episodes: Noise-free episodes a robot at the end.
        validate: Hold out validation robots, and leave the held-out robots alone.
        cuts: Bodies cut out of each group's training robots, at most, that train as well.

    Raises:
        UnknownNameError: A task, split, method or preset does not exist.
        ConfigError: A setting makes no sense, or a method cannot express one of the robots.
    """
    tasks, splits, methods = (tuple(dict.fromkeys(names)) for names in (tasks, splits, methods))
    if not (tasks and splits and methods and seeds > 0):
        raise ConfigError("a matrix needs at least one task, split, method and seed")
    if preset is not None and len(methods) > 1:
        raise ConfigError("--preset goes with a single method; run the others by a command of their own")
    steps = published_steps() if steps is None and minutes is None else steps
    found: list[MatrixPlan] = []
    checked = set()
    for split in splits:
        configs = {name: method_config(name, split, preset=preset, overrides=overrides) for name in methods}
        for task in tasks:
            bodies = gather_bodies(benchmark, task, split, validate=validate, cuts=cuts)
            for config in configs.values():
                for body in (*bodies.train, *bodies.cut, *bodies.validation, *bodies.test):
                    key = (body.name, body.sha256, repr(config))
                    if key not in checked:
                        find_method(config.model.method).check(prepare_robot(config, body).spec, config.model)
                        checked.add(key)
            found += [
                MatrixPlan(Cell(split, task, name, seed), bodies, configs[name], steps, minutes, episodes, validate)
                for name in methods
                for seed in range(seeds)
            ]
    return sorted(found, key=lambda plan: plan.cell.seed)
