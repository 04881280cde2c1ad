"""Where a run shows itself besides its folder: TensorBoard, Weights & Biases or Trackio."""

from __future__ import annotations

import importlib
import json
import os
import secrets
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

from morphkit.errors import DependencyError, OutputError
from morphkit.utils.atomic_write import write_text
from morphkit.utils.plain_files import read_plain
from morphkit.utils.printable import markdown_table
from morphkit_rl.runs.run_folder import CONFIG, TRACKED, TRACKED_NAME

Service = Literal["tensorboard", "wandb", "trackio"]
_MODULES: dict[str, str] = {"tensorboard": "torch.utils.tensorboard", "wandb": "wandb", "trackio": "trackio"}
assert _MODULES.keys() == set(get_args(Service))
_PROJECT = "morphkit"


class Tracker(Protocol):
    """What a run tells a service; names with a slash are groups.

    Attributes:
        films: Endings of the films that it takes.
    """

    films: tuple[str, ...]

    def scalars(self, values: Mapping[str, float], steps: int) -> None:
        """Add a point to curves at so many environment steps."""

    def table(self, name: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], steps: int) -> None:
        """Show a table."""

    def film(self, name: str, path: Path, steps: int) -> None:
        """Show a film, whose ending is one of `films`."""

    def close(self) -> None:
        """Wait until all is written."""


def require(service: Service) -> None:
    """Refuse a service that is not installed, before any work is done.

    Raises:
        DependencyError: It is not.
    """
    try:
        importlib.import_module(_MODULES[service])
    except ImportError as error:
        raise DependencyError(f'--track {service} needs pip install "morphkit[{service}]" ({error})') from None


def open_tracker(run: Path, service: Service, steps: int | None = None) -> Tracker:
    """A service with the settings of a run, which it goes on with where it knows the run.

    Args:
        run: The run folder.
        service: The service.
        steps: Environment steps that training goes on from; None for results of a run that is over.

    Raises:
        DependencyError: The service is not installed.
    """
    require(service)
    settings = json.loads(read_plain(run / CONFIG)) if (run / CONFIG).is_file() else {}
    if service == "tensorboard":
        return _TensorBoard(run, settings, steps)
    kind = _Wandb if service == "wandb" else _Trackio
    return kind(_name(run), settings)


@contextmanager
def named_errors(run: Path, service: Service) -> Iterator[None]:
    """Around all that a tracker does.

    Raises:
        OutputError: The service cannot be reached, or refuses.
    """
    try:
        yield
    except Exception as error:
        if type(error).__module__.partition(".")[0] != service:
            raise
        raise OutputError(f"{run}: cannot track with {service}: {str(error).splitlines()[0]}") from None


def _await_next_second(folder: Path) -> None:
    """TensorBoard reads files in the order of their names, of which one second is the least that tells them apart."""
    while list(folder.glob(f"events.out.tfevents.{int(time.time()):010d}.*")):
        time.sleep(0.05)


class _TensorBoard:
    films: tuple[str, ...] = (".gif",)

    def __init__(self, run: Path, settings: Mapping[str, Any], steps: int | None):
        from torch.utils.tensorboard import SummaryWriter

        purge = None if steps is None else steps + 1  # it takes this step too
        _await_next_second(run / "tensorboard")
        self._writer = SummaryWriter(str(run / "tensorboard"), purge_step=purge)
        if settings and steps == 0:
            text = "\n".join(f"    {line}" for line in json.dumps(settings, indent=2).splitlines())
            self._writer.add_text("config", text, 0)

    def scalars(self, values: Mapping[str, float], steps: int) -> None:
        for tag, value in values.items():
            self._writer.add_scalar(tag, value, steps)
        self._writer.flush()

    def table(self, name: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], steps: int) -> None:
        self._writer.add_text(name, markdown_table(columns, [[str(cell) for cell in row] for row in rows]), steps)

    def film(self, name: str, path: Path, steps: int) -> None:
        from tensorboard.compat.proto.summary_pb2 import Summary

        image = Summary.Image(encoded_image_string=path.read_bytes(), colorspace=3)
        self._writer._get_file_writer().add_summary(Summary(value=[Summary.Value(tag=name, image=image)]), steps)

    def close(self) -> None:
        self._writer.close()


class _Wandb:
    films: tuple[str, ...] = (".mp4", ".gif")

    def __init__(self, name: str, settings: Mapping[str, Any]):
        import wandb

        self._wandb = wandb
        project = os.environ.get("WANDB_PROJECT", _PROJECT)
        quiet = wandb.Settings(silent=True)
        self._run = wandb.init(
            project=project, id=name, name=name, config=dict(settings), resume="allow", settings=quiet
        )
        self._run.define_metric("*", step_metric="steps")  # its own steps may not go back, as those of a resumed run do

    def scalars(self, values: Mapping[str, float], steps: int) -> None:
        self._run.log({**values, "steps": steps})

    def table(self, name: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], steps: int) -> None:
        table = self._wandb.Table(columns=list(columns), data=[list(row) for row in rows])
        self._run.log({name: table, "steps": steps})

    def film(self, name: str, path: Path, steps: int) -> None:
        self._run.log({name: self._wandb.Video(str(path), format=path.suffix[1:]), "steps": steps})

    def close(self) -> None:
        self._run.finish()


class _Trackio:
    films: tuple[str, ...] = (".mp4", ".gif")

    def __init__(self, name: str, settings: Mapping[str, Any]):
        import trackio

        self._trackio = trackio
        project = os.environ.get("TRACKIO_PROJECT", _PROJECT)
        with redirect_stdout(sys.stderr):  # where results are not
            trackio.init(
                project, name=name, config=dict(settings), resume="allow", auto_log_gpu=False, auto_log_cpu=False
            )

    def scalars(self, values: Mapping[str, float], steps: int) -> None:
        self._trackio.log(dict(values), step=steps)

    def table(self, name: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], steps: int) -> None:
        table = self._trackio.Table(columns=list(columns), data=[list(row) for row in rows])
        self._trackio.log({name: table}, step=steps)

    def film(self, name: str, path: Path, steps: int) -> None:
        self._trackio.log({name: self._trackio.Video(path, format=path.suffix[1:])}, step=steps)

    def close(self) -> None:
        with redirect_stdout(sys.stderr):
            self._trackio.finish()


def _name(run: Path) -> str:
    """The name under which a service knows the run: its folder's, and what no other run has."""
    path = run / TRACKED
    if path.is_file():
        name = read_plain(path).decode(errors="replace").strip()
        if TRACKED_NAME.fullmatch(name):
            return name
    words = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in run.resolve().name)[:40]
    name = f"{words}-{secrets.token_hex(4)}"
    write_text(path, name + "\n")
    return name
