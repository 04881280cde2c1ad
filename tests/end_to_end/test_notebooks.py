"""The notebooks of `examples/` from their first cell to their last, with tiny budgets."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from .test_learning import TINY

EXAMPLES = Path(__file__).parents[2] / "examples"
SETTINGS = [word for word in TINY if word != "--set"]
BUDGETS = {
    "reading_a_matrix": {"STEPS": 300, "SEEDS": 1, "SETTINGS": " ".join([*TINY, "--set trainer.evaluate_steps=150"])},
    "tokens_and_ablation": {"VARIANTS": 3},
    "train_and_watch": {"STEPS": 300, "SETTINGS": SETTINGS, "EPISODES": 1, "FILM_STEPS": 3},
    "your_own_policy": {"POPULATION": 8, "GENERATIONS": 3, "STEPS": 20},
}
SAID = {
    "reading_a_matrix": "split 1, hoppers, limb-former, seed 0 - done",
    "tokens_and_ablation": "quadruped-no-",
    "train_and_watch": "never seen",
    "your_own_policy": "generation 2: mean ",
}


def read(name: str) -> nbformat.NotebookNode:
    return nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)


def test_every_notebook_is_tried() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.ipynb")} == set(BUDGETS)


@pytest.mark.parametrize("name", sorted(BUDGETS))
def test_a_notebook_holds_no_outputs(name: str) -> None:
    for cell in read(name).cells:
        assert cell.cell_type == "markdown" or (not cell.outputs and cell.execution_count is None)


@pytest.mark.parametrize("name", sorted(BUDGETS))
def test_a_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    notebook = read(name)
    values = "\n".join(f"{key} = {value!r}" for key, value in BUDGETS[name].items())
    for cell in notebook.cells:
        if "parameters" in cell.metadata.get("tags", ()):
            cell.source += f"\n{values}"
    client = NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}})
    client.execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    said = "".join(output.get("text", "") for output in outputs)
    assert SAID[name] in said
    assert not any(output.get("name") == "stderr" and "error:" in output.text for output in outputs)
