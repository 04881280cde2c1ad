"""A matrix of the benchmark through the installed command: killed, met by a second process, stopped, continued."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .conftest import Run

TINY = (
    *("--set", "model.d_model=16", "--set", "model.layers=1", "--set", "model.feedforward=16"),
    *("--set", "td3.batch_size=16", "--set", "trainer.start_steps=100", "--set", "trainer.num_envs=2"),
    *("--set", "trainer.checkpoint_seconds=0.05", "--set", "trainer.updates_per_sweep=1"),
    *(
        "--set",
        "trainer.log_seconds=0.2",
        "--set",
        "trainer.evaluate_steps=300",
        "--set",
        "trainer.evaluate_episodes=1",
    ),
)


def states(run: Run) -> dict[int, str]:
    cells: list[dict[str, Any]] = json.loads(run("benchmark", "status", "m", "--json").stdout)
    return {cell["seed"]: cell["state"] for cell in cells}


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 300
    while not condition():
        assert process.poll() is None, "it ended before it could be stopped; raise --steps"
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_matrix_survives_kill_and_ctrl_c_and_a_second_process(
    morphkit: Run, start: Callable[..., subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    cells = ("--task", "hoppers", "--split", "1", "--method", "limb-former", "--out", "m")
    arguments = ("benchmark", "run", *cells, "--steps", 1000, "--episodes", 2, *TINY)
    cell = tmp_path / "m/1/hoppers/limb-former/seed-0"

    process = start(*arguments, "--seeds", 2)
    wait_for((cell / "run/checkpoints/latest").exists, process)
    process.kill()
    process.wait()
    assert states(morphkit) == {0: "stopped", 1: "not started"}
    first = (cell / "run/metrics.jsonl").read_text().partition("\n")[0]

    # The first process is still while the second one looks, however slow the machine is.
    process = start(*arguments, "--seeds", 2)
    wait_for(lambda: f'"pid": {process.pid},' in (cell / "owner.json").read_text(), process)
    process.send_signal(signal.SIGSTOP)
    other = morphkit(*arguments, "--seeds", 1)
    assert "seed 0: running: process" in other.stderr
    assert states(morphkit) == {0: "running", 1: "not started"}
    process.send_signal(signal.SIGCONT)
    process.send_signal(signal.SIGINT)
    assert process.wait(300) == 130
    assert states(morphkit) == {0: "stopped", 1: "not started"}

    done = morphkit(*arguments, "--seeds", 2)
    assert "2 cells: 2 done" in done.stderr
    lines = (cell / "run/metrics.jsonl").read_text().splitlines()
    assert lines[0] == first or not first, "it went on, it did not start again"
    rows = [json.loads(line) for line in lines]
    assert rows[-1]["steps"] >= 1000
    assert [row["steps"] for row in rows] == sorted(row["steps"] for row in rows)
    evaluated = [row["evaluation"] for row in rows if row.get("evaluation")]
    assert evaluated
    assert set(evaluated[0]) == {"hopper_3", "hopper_4", "hopper_5"}
    result = json.loads((cell / "result.json").read_text())
    assert {robot["role"] for robot in result["robots"]} == {"train"}, "hoppers hold nothing out"
    assert all(len(robot["returns"]) == 2 for robot in result["robots"])
    assert result["steps"] == rows[-1]["steps"]

    morphkit("benchmark", "report", "m")
    report = json.loads((tmp_path / "m/report/report.json").read_text())
    assert report["complete"]
    assert [row["seeds_done"] for row in report["tasks"]] == [2]
