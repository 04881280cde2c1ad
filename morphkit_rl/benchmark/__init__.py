"""The modular-rl benchmark: tasks, splits and published results as data, a runner, statistics and reports."""
