"""Token specifications as JSON (schema version 1) and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

from morphkit.errors import DescriptionError
from morphkit.morphology import Origin
from morphkit.tokens.records import ActuatorToken, SensorToken, TokenLimb

SCHEMA_VERSION = 1

_Record = TypeVar("_Record")

_COLUMNS = (
    *("kind", "index", "name", "text", "limb", "joint", "quantity", "component", "unit", "frame", "low", "high"),
)

_SOURCE = ("file", "format", "sha256")
_ABOUT = ("naming", "family", "task", "base")


def to_json(spec: Mapping[str, Any]) -> str:
    """The fields of a `TokenSpec` as JSON: keys in the order of the schema, indented by two, a newline at the end."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "morphology": spec["morphology"],
        "source": {key: spec[key] for key in _SOURCE},
        **{key: spec[key] for key in _ABOUT},
        **{key: [_as_dict(each) for each in spec[key]] for key in ("limbs", "sensors", "actuators")},
    }
    if spec["given_names"]:
        document["given_names"] = [_as_dict(each) for each in spec["given_names"]]
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_csv(sensors: Sequence[SensorToken], actuators: Sequence[ActuatorToken]) -> str:
    """One row a token under a header, sensors first; `ctrl` is the quantity of an actuator."""
    output = io.StringIO()
    writer = csv.DictWriter(output, _COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({"kind": "sensor", **_as_dict(sensor)} for sensor in sensors)
    writer.writerows({"kind": "actuator", "quantity": "ctrl", **_as_dict(actuator)} for actuator in actuators)
    return output.getvalue()


def _as_dict(record: Any) -> dict[str, Any]:
    """The fields of a flat dataclass; `dataclasses.asdict` would copy every string deeply, which takes seconds."""
    return {name: getattr(record, name) for name in record.__slots__}


def from_json(text: str) -> dict[str, Any]:
    """Read the JSON of a token specification.

    Returns:
        The fields of a `TokenSpec`.

    Raises:
        DescriptionError: Where the text is no JSON, of another schema version, lacks a key or contradicts itself.
    """
    try:
        document = json.loads(text)
    except ValueError as error:
        raise DescriptionError(f"token specification: no JSON: {error}") from error
    version = _get(document, "schema_version", "")
    if version != SCHEMA_VERSION:
        raise DescriptionError(
            f"token specification: schema_version is {version!r}, this morphkit reads {SCHEMA_VERSION}; "
            "write the file anew with `morphkit tokens ROBOT --format json`"
        )
    source = _get(document, "source", "")
    limbs = [
        TokenLimb(**(_record(TokenLimb, item, f"limbs[{i}]") | {"joints": tuple(_list(item, "joints", f"limbs[{i}]"))}))
        for i, item in enumerate(_list(document, "limbs"))
    ]
    sensors = [_record(SensorToken, item, f"sensors[{i}]") for i, item in enumerate(_list(document, "sensors"))]
    actuators = [_record(ActuatorToken, item, f"actuators[{i}]") for i, item in enumerate(_list(document, "actuators"))]
    _check_references({limb.name for limb in limbs}, sensors=sensors, actuators=actuators)
    given = _list(document, "given_names") if "given_names" in document else []
    return {
        "morphology": _get(document, "morphology", ""),
        **{key: _get(source, key, "source") for key in _SOURCE},
        **{key: _get(document, key, "") for key in _ABOUT},
        "limbs": tuple(limbs),
        "sensors": tuple(SensorToken(**sensor) for sensor in sensors),
        "actuators": tuple(ActuatorToken(**actuator) for actuator in actuators),
        "given_names": tuple(Origin(**_record(Origin, item, f"given_names[{i}]")) for i, item in enumerate(given)),
    }


def _record(cls: type[_Record], item: Any, where: str) -> dict[str, Any]:
    """The fields of `cls` out of `item`, each of which must be there."""
    return {field.name: _get(item, field.name, where) for field in fields(cls)}  # type: ignore[arg-type]


def _list(item: Any, key: str, where: str = "") -> list[Any]:
    value = _get(item, key, where)
    if not isinstance(value, list):
        raise DescriptionError(f"token specification: {_dotted(where, key)} must be a list, not {value!r}")
    return value


def _get(item: Any, key: str, where: str) -> Any:
    if not isinstance(item, Mapping):
        raise DescriptionError(f"token specification: {where or 'the document'} must be an object")
    if key not in item:
        raise DescriptionError(f"token specification: {_dotted(where, key)} is missing")
    return item[key]


def _dotted(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _check_references(limbs: set[str], **lists: list[dict[str, Any]]) -> None:
    for kind, records in lists.items():
        for i, record in enumerate(records):
            if record["index"] != i:
                raise DescriptionError(f"token specification: {kind}[{i}].index is {record['index']!r}, expected {i}")
            if record["limb"] is not None and record["limb"] not in limbs:
                raise DescriptionError(f"token specification: {kind}[{i}].limb {record['limb']!r} is not among limbs")
