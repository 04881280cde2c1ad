"""The one schema of all JSON that a run or a matrix holds; whatever is read is checked against it first."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import pydantic
from pydantic import ConfigDict, Field, TypeAdapter

from morphkit.description import RobotInfo
from morphkit.errors import CheckpointError
from morphkit.morphology import Base, Format
from morphkit.utils.plain_files import read_plain
from morphkit_rl.runs.run_folder import ROBOT_NAME, SEGMENT_NAME

Count = Annotated[int, Field(ge=0, le=2**53)]
Word = Annotated[int, Field(ge=0, lt=2**128)]
Positive = Annotated[float, Field(gt=0)]
Unbounded = Annotated[float, Field(allow_inf_nan=True)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}\z")]
FileName = Annotated[str, Field(pattern=r"^[a-z_]{1,64}\.safetensors\z")]


class Part(pydantic.BaseModel):
    """A JSON object with the keys that it names and no others; numbers are finite and never text."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, hide_input_in_errors=True)


class File(Part):
    """A file of a checkpoint."""

    size: Count
    sha256: Sha256


class Segment(Part):
    """A replay segment; those of version 2 have no digest."""

    file: Annotated[str, Field(pattern=f"^{SEGMENT_NAME.pattern}\\z")]
    first: Count
    last: Count
    size: Count | None = None
    sha256: Sha256 | None = None


class _Words(Part):
    state: Word
    inc: Word


class Generator(Part):
    """State of numpy's PCG64."""

    bit_generator: Literal["PCG64"]
    state: _Words
    has_uint32: Annotated[int, Field(ge=0, le=1)]
    uinteger: Annotated[int, Field(ge=0, lt=2**32)]


class VocabularyEntry(Part):
    """What networks were made for; see `models.vocabulary`."""

    sensors: list[str]
    actions: list[str]
    texts: list[str]
    scalars: Count
    children: Count
    robots: list[str] = []
    bodies: list[list[Count]] = []
    quantities: list[str] = []


class _Sweeps(Part):
    name: Literal["sweeps"]
    first: list[list[bool]]


class _Rounds(Part):
    name: Literal["rounds"]
    over: list[list[bool]]
    counted: list[Count]
    updates_due: list[Count]
    updates_left: list[Count]


class _Evaluation(Part):
    done: Count
    random: list[float]
    best: float | None = None


class State(Part):
    """`state.json` of a checkpoint; those of version 2 have sizes of files, and no digests."""

    format_version: Literal[2, 3]
    method: str
    vocabulary: VocabularyEntry
    quantities: list[str]
    token_texts: Sha256
    precision: Literal["float32", "bfloat16"]
    elapsed_s: Annotated[float, Field(ge=0)]
    steps: Count
    real_steps: Count
    updates: Count
    episodes: Count
    sweeps: Count
    recent: list[list[float]]
    recent_first: list[list[float]] | None = None
    ended: list[Count] | None = None
    segments: list[Segment]
    rng: Generator
    schedule: Annotated[_Sweeps | _Rounds, Field(discriminator="name")]
    evaluation: _Evaluation
    files: dict[FileName, File] | dict[FileName, Count]
    sha256: Sha256 | None = None

    @pydantic.model_validator(mode="after")
    def _has_digests(self) -> State:
        if self.format_version > 2:
            parts = (*self.files.values(), *self.segments)
            if self.sha256 is None or not all(getattr(part, "sha256", None) for part in parts):
                raise ValueError("a digest is missing")
        return self


class RobotEntry(Part):
    """A robot of a run; `robot_info` checks `info`."""

    name: str
    file: str
    source: Annotated[str, Field(pattern=f"^{ROBOT_NAME.pattern}\\z")]
    format: Format
    sha256: Sha256
    folder: str | None
    packages: dict[str, str] = {}
    root: str | None
    info: dict[str, Any]


class _Machine(Part):
    processor: Annotated[str, Field(max_length=200)]
    cores: Annotated[int, Field(ge=1)]


class Config(Part):
    """`config.json`; `TrainConfig.from_dict` checks `config`."""

    robots: Annotated[list[RobotEntry], Field(min_length=1)]
    validation: list[RobotEntry] = []
    hold_out: list[str]
    config: dict[str, dict[str, Any]]
    task: str | None
    task_toml: Annotated[str, Field(max_length=2**20)] | None = None
    base: Base | None
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    minutes: Positive | None
    steps: Annotated[int, Field(gt=0, le=2**53)] | None
    device: str
    threads: Annotated[int, Field(ge=1, le=1024)]
    versions: dict[str, str] | None = None
    git_commit: str | None = None
    machine: _Machine | None = None
    mended: dict[str, list[str]] | None = None


class _Score(Part):
    mean: float
    returns: list[float]
    score: float | None


class Row(Part):
    """A row of `metrics.jsonl`; what is not named here are numbers of the learner, which may be infinite."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Unbounded | None]

    steps: Count
    updates: Count
    real_steps: Count | None = None
    elapsed_s: float | None = None
    episodes: Count | None = None
    diverged: Count | None = None
    return_mean: float | None = None
    returns: dict[str, float] = {}
    first_return_mean: float | None = None
    first_returns: dict[str, float] = {}
    evaluation: dict[str, _Score] | None = None


_GENERATORS = TypeAdapter(list[tuple[str, Generator]], config=ConfigDict(strict=True))


class _AnySize(Part):
    model_config = ConfigDict(allow_inf_nan=True)


_INFO = {name: (hint, getattr(RobotInfo(), name)) for name, hint in get_type_hints(RobotInfo).items()}
_ROBOT_INFO: type[pydantic.BaseModel] = pydantic.create_model("RobotInfo", __base__=_AnySize, **_INFO)  # type: ignore[call-overload]


def read(path: Path, kind: type[pydantic.BaseModel], *, lacking: str = "lacks") -> dict[str, Any]:
    """Read a JSON file.

    Args:
        path: The file.
        kind: What it has to hold.
        lacking: The verb of the message on a key that is missing.

    Raises:
        CheckpointError: It is missing, is no JSON, or holds something else.
    """
    try:
        source = read_plain(path)
    except OSError as error:
        raise CheckpointError(f"{path}: damaged or missing: {error.strerror}") from None
    return parse(source, kind, str(path), lacking=lacking)


def parse(source: bytes, kind: type[pydantic.BaseModel], place: str, *, lacking: str = "lacks") -> dict[str, Any]:
    """The values in JSON text; otherwise as `read`."""
    try:
        kind.model_validate_json(source)
        values: dict[str, Any] = json.loads(source)
    except pydantic.ValidationError as error:
        raise CheckpointError(f"{place}: damaged: {_reason(error, lacking)}") from None
    except (ValueError, RecursionError) as error:
        raise CheckpointError(f"{place}: damaged: {error}") from None
    return values


def robot_info(values: dict[str, Any], place: str) -> RobotInfo:
    """What a run says of a robot besides its file.

    Raises:
        CheckpointError: It makes no sense.
    """
    try:
        found = _ROBOT_INFO.model_validate_json(json.dumps(values))
    except pydantic.ValidationError as error:
        raise CheckpointError(f"{place}: damaged: {_reason(error)}") from None
    info = RobotInfo(**{name: getattr(found, name) for name in _INFO})
    low, high = info.healthy_height or (0.0, 1.0)
    if not low < high:
        raise CheckpointError(f"{place}: damaged: healthy_height is from {low} to {high}")
    if not all(0 < stiffness < math.inf and 0 <= damping < math.inf for stiffness, damping in info.gains.values()):
        raise CheckpointError(f"{place}: damaged: gains are {info.gains}")
    for name in ("action_scale", "control_frequency"):
        if not 0 < (getattr(info, name) or 1.0) < math.inf:
            raise CheckpointError(f"{place}: damaged: {name} is {getattr(info, name)}")
    return info


def check_generators(source: bytes, place: str) -> None:
    """Refuse what is no list of names and states of their random generators.

    Raises:
        CheckpointError: It is something else.
    """
    try:
        _GENERATORS.validate_json(source)
    except pydantic.ValidationError as error:
        raise CheckpointError(f"{place}: damaged: {_reason(error)}") from None


def digest(values: dict[str, Any]) -> str:
    """SHA-256 of JSON values, whatever their order; a key `sha256` of their own is left out."""
    rest = {key: value for key, value in values.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _reason(error: pydantic.ValidationError, lacking: str = "lacks") -> str:
    """What is wrong first of all; something missing before all else."""
    found = error.errors(include_url=False, include_input=False, include_context=False)
    first = next((each for each in found if each["type"] == "missing"), found[0])
    where = ".".join(str(part)[:40] for part in first["loc"])
    if first["type"] == "missing":
        return f"it {lacking} {where!r}"
    what = " ".join(first["msg"].split())[:200]
    return f"{ascii(where)[1:-1]}: {what}" if where else what
