"""Cells and seeds as tasks of a Ray cluster, through the installed command; see `make test-cluster`."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from safetensors.numpy import load_file

from .conftest import Run
from .test_benchmark import TINY

pytest.importorskip("ray")

Start = Callable[..., subprocess.Popen[bytes]]
CELLS = ("benchmark", "run", "--task", "hoppers", "--split", "1", "--method", "limb-former", "--episodes", 1, *TINY)
SEED = "1/hoppers/limb-former/seed-{}"


def wait_for(condition: Callable[[], Any], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 300
    while not condition():
        assert process.poll() is None, "it ended before it could be disturbed; raise --steps"
        assert time.monotonic() < deadline
        time.sleep(0.02)


def owner(cell: Path) -> int:
    """The process that works on a cell; 0 for none."""
    try:
        return int(json.loads((cell / "owner.json").read_text())["pid"])
    except (OSError, ValueError):
        return 0


def assert_same(cell: Path, other: Path) -> None:
    """Two cells have the same weights, to the last bit, and the same returns."""
    for name in ("policy", "learner", "optimizer"):
        one, two = (
            load_file(
                folder
                / "run/checkpoints"
                / (folder / "run/checkpoints/latest").read_text().strip()
                / f"{name}.safetensors"
            )
            for folder in (cell, other)
        )
        assert one.keys() == two.keys()
        assert all((one[key] == two[key]).all() for key in one)
    results = [json.loads((folder / "result.json").read_text()) for folder in (cell, other)]
    assert results[0]["robots"] == results[1]["robots"]


@pytest.fixture
def two_nodes() -> Iterator[Any]:
    """A cluster whose head runs nothing and whose two nodes run one cell each."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    yield cluster
    cluster.shutdown()


def test_a_cell_whose_node_dies_goes_on_on_another_and_ends_as_without_ray(
    two_nodes: Any, morphkit: Run, start: Start, tmp_path: Path
) -> None:
    words = (*CELLS, "--seeds", 1, "--steps", 2500)
    morphkit(*words, "--out", "plain")
    cell = tmp_path / "m" / SEED.format(0)
    process = start(*words, "--out", "m", "--ray", two_nodes.address)
    wait_for(lambda: (cell / "run/checkpoints/latest").exists() and owner(cell), process)
    assert json.loads(morphkit("benchmark", "status", "m", "--json").stdout)[0]["state"] == "running"
    raylet = int(Path(f"/proc/{owner(cell)}/stat").read_text().rpartition(")")[2].split()[1])
    (node,) = (n for n in two_nodes.worker_nodes if n.all_processes["raylet"][0].process.pid == raylet)
    first = owner(cell)
    two_nodes.remove_node(node, allow_graceful=False)
    wait_for(
        lambda: owner(cell) not in (0, first) or process.poll() is not None or (cell / "result.json").exists(), process
    )
    assert process.wait(300) == 0
    assert_same(cell, tmp_path / "plain" / SEED.format(0))


def test_cells_are_handed_on_through_a_storage_and_stop_at_checkpoints(
    morphkit: Run, start: Start, tmp_path: Path
) -> None:
    words = (*CELLS, "--seeds", 1, "--steps", 2500)
    morphkit(*words, "--out", "plain")
    shared = (*words, "--out", "m", "--ray", "--storage", f"file://{tmp_path}/store")
    stored, cell = tmp_path / "store" / SEED.format(0), tmp_path / "m" / SEED.format(0)
    process = start(*shared)
    wait_for((stored / "run/checkpoints/latest").exists, process)
    wait_for((cell / "run/metrics.jsonl").exists, process)
    process.send_signal(signal.SIGINT)
    assert process.wait(300) == 130
    steps = json.loads((stored / "run/metrics.jsonl").read_text().splitlines()[-1])["steps"]
    assert 0 < steps < 2500
    done = morphkit(*shared)
    assert "1 cell: 1 done" in done.stderr
    assert_same(cell, tmp_path / "plain" / SEED.format(0))
    rows = [json.loads(line)["steps"] for line in (cell / "run/metrics.jsonl").read_text().splitlines()]
    assert rows == sorted(rows)


def test_seeds_train_side_by_side_as_they_do_alone(morphkit: Run, tmp_path: Path) -> None:
    words = ("train", "hopper_3", "--steps", 600, *TINY)
    morphkit(*words, "--seed", 1, "--run", "alone")
    done = morphkit(*words, "--seeds", 2, "--run", "runs", "--ray", "--cpus", 0.5)
    assert done.stderr.count(": done") == 2
    latest = [(tmp_path / run / "checkpoints/latest").read_text().strip() for run in ("alone", "runs/seed-1")]
    one, two = (
        load_file(tmp_path / run / "checkpoints" / name / "policy.safetensors")
        for run, name in zip(("alone", "runs/seed-1"), latest, strict=True)
    )
    assert all((one[key] == two[key]).all() for key in one)


def test_sigterm_stops_the_cells_and_the_cluster_of_this_machine(start: Start, tmp_path: Path) -> None:
    cell = tmp_path / "m" / SEED.format(0)
    process = start(*CELLS, "--seeds", 1, "--steps", 100_000, "--out", "m", "--ray")
    wait_for(lambda: (cell / "run/metrics.jsonl").exists() and owner(cell), process)
    worker = owner(cell)
    process.send_signal(signal.SIGTERM)
    assert process.wait(300) == 143
    assert (cell / "run/checkpoints/latest").is_file()
    deadline = time.monotonic() + 30
    while Path(f"/proc/{worker}").exists():
        assert time.monotonic() < deadline, "its worker outlived it"
        time.sleep(0.1)
