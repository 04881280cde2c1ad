"""The job script for Slurm, with SIGTERM in place of the end of its time."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

from .conftest import COMMAND, environment
from .test_benchmark import TINY

SCRIPT = Path(__file__).parents[2] / "examples/slurm_benchmark.sh"


def test_a_job_whose_time_is_up_leaves_a_checkpoint_and_queues_itself_again(tmp_path: Path) -> None:
    (tmp_path / "scontrol").write_text('#!/bin/sh\necho "$@" > queued\n')
    (tmp_path / "scontrol").chmod(0o755)
    slurm = {"SLURM_ARRAY_JOB_ID": "7", "SLURM_ARRAY_TASK_ID": "3", "SLURM_CPUS_PER_TASK": "1"}
    path = os.pathsep.join([str(tmp_path), str(COMMAND.parent), os.environ["PATH"]])
    words = ["--task", "hoppers", "--split", "1", "--method", "limb-former", "--seeds", "1", "--steps", "100000", *TINY]
    job = subprocess.Popen([SCRIPT, *words, "--out", "m"], cwd=tmp_path, env={**environment(), **slurm, "PATH": path})
    latest, deadline = tmp_path / "m/1/hoppers/limb-former/seed-0/run/checkpoints/latest", time.monotonic() + 300
    try:
        while not latest.exists():
            assert job.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
        job.send_signal(signal.SIGTERM)
        assert job.wait(300) == 143
    finally:
        job.kill()
    assert (tmp_path / "queued").read_text() == "requeue 7_3\n"
    assert not (latest.parents[2] / "owner.json").exists()
