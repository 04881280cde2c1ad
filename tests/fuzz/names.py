"""Robots, files, tasks and runs of names that steer terminals, read like others, or mean something to a library.

A case is JSON: names, and numbers that choose what to do with them.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from hypothesis import strategies as st
from lxml import etree

from tests.support.command_output import printed_by, refuse_raw

TRICKS = (
    "\x9b31m", "\u202e", "\u2066", "\u200b", "\n\nerror: forged", "\u2028", "\r", "\t", "\x85", "\x7f", "\xad", "\n",
    "\ufeff", "\U000e0041", "|", "`", "$\\frac$", "$", "_", "[red]", "[/]", "{0}", "{x.__class__}", "%s%n", "<script>",
    "&amp;", "=1+1", "../../x", "/", "\\", "..", ".", " ", "''", '"', "-rf", "--help", "~", "*", "?", "left", "1",
    "e\u0301", "\u00e9", "\u0430", "\uff54orso", "\u212a", "\u0130", "\u00df", "\u05d0", "x" * 300, "y" * 5000,
    "\U0001f600",
)  # fmt: skip
IN_FILES = ("\x1b[31m", "\x1b]0;title\x07", "\x01", "\udc9b")
"""Which XML cannot hold."""
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
SMALL = (
    "--steps 8 --quiet --set trainer.start_steps=4 --set td3.batch_size=4 --set trainer.num_envs=2 --set model.layers=1"
    " --set model.d_model=16 --set model.feedforward=16 --set trainer.updates_per_sweep=1"
)
COMMANDS = (
    "tokens ROBOT; tokens ROBOT --root FOOT",
    "tokens ROBOT --json; tokens ROBOT --output OUT/tokens.json --format json",
    "show ROBOT",
    "check ROBOT --quick",
    "check ROBOT --quick --output sarif; check ROBOT --quick --json",
    "ablate ROBOT --remove=FOOT --dry-run; ablate ROBOT --splice=FOOT --dry-run --json",
    "ablate ROBOT --remove=FOOT --name WORD --output OUT/cut; tokens OUT/cut",
    "ablate ROBOT --all --no-compile --limit 2 --output OUT/family; benchmark random OUT/family --episodes 1",
    "diff ROBOT ROBOT; diff ROBOT hopper --json",
    "convert ROBOT OUT/converted.OTHER",
    "benchmark random ROBOT --episodes 1 --format markdown; benchmark random ROBOT --episodes 1 --json",
    "benchmark robots --file OUT/own.toml; benchmark robots --file OUT/own.toml --json",
    "benchmark run --file OUT/own.toml --task WORD --split WORD --method WORD --out OUT/matrix",
    "benchmark status RUN; benchmark report RUN",
    f"train ROBOT --run RUN --task WORD {SMALL}; train ROBOT --run RUN --hold-out=FOOT {SMALL}",
    f"train ROBOT --run RUN {SMALL}; evaluate RUN ROBOT --episodes 1; coverage RUN ROBOT",
    f"train ROBOT --run RUN {SMALL} --json; evaluate RUN ROBOT --episodes 1 --json; coverage RUN ROBOT --json",
    "train ROBOT --run RUN --set model.WORD=1; train ROBOT --run RUN --preset WORD",
    "evaluate zoo:WORD ROBOT; show zoo:WORD; tokens WORD; export WORD ROBOT --onnx OUT/policy.onnx",
)
"""What can be done: commands in a row."""

_words = st.sampled_from(("torso", "leg", "foot", "hip", "ankle", "a", ""))
_marks = st.sampled_from((*TRICKS, *IN_FILES))
hostile = st.one_of(
    st.tuples(_words, _marks).map("".join),
    st.tuples(_words, _marks, _words, _marks).map("".join),
    _marks,
    st.text(max_size=20),
)


def examples() -> st.SearchStrategy[dict[str, bytes]]:
    """Six names of elements, one of a file, and what is done."""
    parts = {
        "names": st.lists(hostile, min_size=6, max_size=6),
        "file": hostile,
        "urdf": st.booleans(),
        "do": st.lists(st.integers(0, 10**6), min_size=2, max_size=3),
    }
    return st.fixed_dictionaries(parts).map(lambda case: {"names.json": json.dumps(case).encode()})


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Run commands over a robot of such names; neither what they print nor what they write may hold them raw."""
    case = json.loads(files["names.json"])
    names = [_NO_XML.sub("", name) for name in case["names"]]
    source = _urdf(names) if case["urdf"] else _mjcf(names)
    robot = folder / _file_name(case["file"], ".urdf" if case["urdf"] else ".xml")
    robot.write_bytes(source)
    out = folder / "out"
    out.mkdir()
    word = case["file"].replace("\0", "").encode(errors="replace").decode()
    _define(out / "own.toml", word, robot)
    values = {
        "ROBOT": str(robot),
        "FOOT": names[2],
        "WORD": word,
        "RUN": str(out / _file_name(case["file"], "-run")),
        "OUT": str(out),
        "OTHER": "xml" if case["urdf"] else "urdf",
    }
    codes = []
    for number in case["do"]:
        for command in COMMANDS[number % len(COMMANDS)].split("; "):
            words = [re.sub("|".join(values), lambda found: values[found[0]], each) for each in command.split()]
            codes.append(printed_by(words)[0])
    _check_files(out)
    return "used" if 2 not in codes else "refused" if set(codes) == {2} else "refused in part"


def _define(file: Path, word: str, robot: Path) -> None:
    """Write a benchmark of one task and one split, all called `word`."""
    name = json.dumps(word, ensure_ascii=False).replace("\x7f", "\\u007f")
    train = json.dumps(str(robot).encode(errors="replace").decode(), ensure_ascii=False).replace("\x7f", "\\u007f")
    sets = f'{{train = [{train}, "hopper"], test = [{name}]}}'
    file.write_text(f"[tasks]\n{name} = [{name}]\n[splits.{name}]\n{name} = {sets}\n", encoding="utf-8")


def _check_files(out: Path) -> None:
    """Files that were written have safe names, apart from those that were asked for, and are whole."""
    for path in out.rglob("*"):
        place = path.relative_to(out)
        if len(place.parts) > 1:
            refuse_raw(path.name, path)
        if path.suffix in (".md", ".csv", ".txt"):
            refuse_raw(path.read_text("utf-8"), path)
        elif path.suffix == ".json" and path.is_file():
            json.loads(path.read_bytes())
        elif path.suffix in (".xml", ".urdf") and path.is_file():
            etree.fromstring(path.read_bytes())
    shutil.rmtree(out)


def _file_name(name: str, suffix: str) -> str:
    """A name that the file system takes: without slash and zero, at most 200 bytes."""
    kept = re.sub("[/\0\ud800-\udc7f\udd00-\udfff]", "", name).encode(errors="surrogateescape")
    return kept[:200].decode(errors="surrogateescape") + suffix


def _mjcf(names: list[str]) -> bytes:
    torso, leg, foot, hip, ankle, motor = names
    root = etree.Element("mujoco", model=torso)
    body = etree.SubElement(etree.SubElement(root, "worldbody"), "body", name=torso)
    etree.SubElement(body, "geom", size=".1")
    for name, joint in ((leg, hip), (foot, ankle)):
        body = etree.SubElement(body, "body", name=name, pos="0 0 -.3")
        etree.SubElement(body, "joint", name=joint, axis="0 1 0", range="-40 40")
        etree.SubElement(body, "geom", size=".1")
    etree.SubElement(etree.SubElement(root, "actuator"), "motor", name=motor, joint=hip)
    return bytes(etree.tostring(root))


def _urdf(names: list[str]) -> bytes:
    torso, leg, foot, hip, ankle, material = names
    root = etree.Element("robot", name=torso)
    for name in (torso, leg, foot):
        link = etree.SubElement(root, "link", name=name)
        inertial = etree.SubElement(link, "inertial")
        etree.SubElement(inertial, "mass", value="1")
        etree.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
        visual = etree.SubElement(link, "visual")
        etree.SubElement(etree.SubElement(visual, "geometry"), "sphere", radius=".1")
        etree.SubElement(visual, "material", name=material)
    for name, above, below in ((hip, torso, leg), (ankle, leg, foot)):
        joint = etree.SubElement(root, "joint", name=name, type="revolute")
        etree.SubElement(joint, "parent", link=above)
        etree.SubElement(joint, "child", link=below)
        etree.SubElement(joint, "axis", xyz="0 1 0")
        etree.SubElement(joint, "limit", lower="-1", upper="1", effort="5", velocity="5")
    return bytes(etree.tostring(root))
