"""Files that were made to do harm: a clear error, soon, in little memory."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import mujoco
import pytest

from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError, MorphkitError
from morphkit.formats import limits, xml
from morphkit.formats.assets import find_asset, mentions
from morphkit.formats.document import document_of
from morphkit.naming.unique import TakenNames
from morphkit.readers import read
from morphkit.registry import load
from morphkit.simulation.spec import load_spec
from morphkit.tokens.spec import token_spec
from morphkit.utils.suggest import did_you_mean

BODY = '<body name="a"><geom size="1"/>{}</body>'
NAMES = ("a b", "c/d", "../e", "é漢😀", "f'g", "h\\i", "-j", "$(rm)", "k\u202e", 'l"m', "n\no", "{p}", "%s")


def mjcf(world: str, more: str = "", folder: Path | None = None) -> Description:
    text = f"<mujoco>{more}<worldbody>{world}</worldbody></mujoco>"
    return Description("r", "r.xml", "mjcf", text.encode(), folder)


def urdf(links: int, joints: str) -> Description:
    text = "".join(f'<link name="l{i}"/>' for i in range(links))
    return Description("r", "r.urdf", "urdf", f'<robot name="r">{text}{joints}</robot>'.encode())


def joint(number: int, parent: int, child: int) -> str:
    ends = f'<parent link="l{parent}"/><child link="l{child}"/>'
    return f'<joint name="j{number}" type="continuous">{ends}</joint>'


@pytest.mark.parametrize(
    ("world", "more", "words"),
    [
        (
            BODY.format('<replicate count="1000000000">' + BODY.format("<joint/>") + "</replicate>"),
            "",
            "limit is 20,000",
        ),
        (BODY.format('<replicate count="1000000000"><geom size="1"/></replicate>'), "", "limit is 20,000"),
        (BODY.format('<flexcomp name="f" type="grid" count="9999 9999 1" spacing="1 1 1"/>'), "", "limit is 20,000"),
        (BODY.format(""), '<asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>', "numbers"),
        (BODY.format(""), '<asset><texture name="h" builtin="flat" width="99999" height="99999"/></asset>', "numbers"),
        (BODY.format('<camera name="c" resolution="99999 99999"/>'), "", "numbers"),
        (BODY.format(""), '<sensor><user dim="2000000000"/></sensor>', "numbers"),
        (BODY.format(""), '<size nuser_body="1000000000"/>', "numbers"),
        (BODY.format('<site pos="0 nan 0"/>'), "", "NaN is no number"),
        (BODY.format('<joint range="-inf 1e999"/>'), "", "too large"),
        ("<body>" * 10_000 + "</body>" * 10_000, "", "deeper than 256"),
        (f'<body name="{"a" * 2000}"/>', "", "name of 2,000 characters"),
        (BODY.format(""), f'<deformable><flex name="f" body="{"a" * 2000}"/></deformable>', "body of 2,000 characters"),
        ("<body " + " ".join(f'a{i}=""' for i in range(100_000)) + "/>", "", "has 100,000 attributes"),
        (f'<body name="{"a" * 11_000_000}"/>', "", "more than 10 MB"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_mjcf_that_asks_for_too_much(world: str, more: str, words: str) -> None:
    start = time.process_time()
    with pytest.raises(DescriptionError, match=words):
        read(mjcf(world, more))
    assert time.process_time() - start < 5


def test_a_list_of_many_names_is_no_long_name() -> None:
    names = [f"particle_of_a_piece_of_cloth_{i}" for i in range(100)]
    bodies = "".join(
        f'<body name="{name}" pos="0 0 {i}"><joint/><geom size=".1"/></body>' for i, name in enumerate(names)
    )
    flex = f'<deformable><flex name="f" dim="1" body="{" ".join(names)}" element="{" ".join(map(str, range(100)))}"/>'
    cloth = mjcf(BODY.format(bodies), f"{flex}</deformable>")
    assert len(read(cloth).limbs) == 101
    assert mujoco.MjModel.from_xml_string(cloth.source.decode()).nflexvert == 100


def test_a_file_of_many_gigabytes_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "huge.urdf").touch()
    os.truncate(tmp_path / "huge.urdf", 10**10)
    with pytest.raises(DescriptionError, match="9537 MiB of XML"):
        load(tmp_path / "huge.urdf")


def test_too_many_tags_and_links(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DescriptionError, match="1,000,000 tags"):
        xml.parse(b"<robot>" + b"<a/>" * 1_000_000 + b"</robot>", file="r.urdf")
    monkeypatch.setattr(limits, "BODIES", 10)
    with pytest.raises(DescriptionError, match=r"r\.urdf: makes 11 link elements"):
        read(urdf(11, ""))


def test_a_long_chain_and_a_long_ring() -> None:
    count = 3000
    chain = [joint(i, i, i + 1) for i in range(count - 1)]
    morphology = read(urdf(count, "".join(chain)))
    assert len(list(morphology.subtree("l0"))) == count
    with pytest.raises(DescriptionError, match=f"form a cycle: {count} links"):
        read(urdf(count, "".join([*chain, joint(count, count - 1, 0)])))
    with pytest.raises(DescriptionError, match=r"l49 and 2,950 others"):
        read(urdf(count, ""))


def test_a_chain_too_long_to_simulate(tmp_path: Path) -> None:
    longest = limits.CHAIN + 1
    chain = [joint(i, i, i + 1) for i in range(longest - 1)]
    fork = [joint(longest, longest - 2, longest)]
    load_spec(urdf(longest + 1, "".join([*reversed(chain), *fork])))
    long = urdf(10_000, "".join(joint(i, i, i + 1) for i in range(9999)))
    start = time.process_time()
    with pytest.raises(DescriptionError, match="a chain of more than 250 links"):
        load_spec(long)
    with pytest.raises(DescriptionError, match="a chain of more than 250 links"):
        convert(long)
    assert time.process_time() - start < 20


def test_names_are_numbered_in_linear_time() -> None:
    names = TakenNames()
    start = time.process_time()
    assert [names.give("a") for _ in range(50_000)][-1] == "a_50000"
    assert time.process_time() - start < 2
    did_you_mean("b" * 10**6, ["a" * 10**6] * 10)
    assert time.process_time() - start < 4


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_names_of_every_kind_survive(form: str) -> None:
    from xml.sax.saxutils import quoteattr

    quoted = [quoteattr(name, {"\n": "&#10;"}) for name in NAMES]
    if form == "urdf":
        links = "".join(f"<link name={name}/>" for name in quoted)
        joints = "".join(
            f'<joint name="j{i}" type="continuous"><parent link="root"/><child link={name}/></joint>'
            for i, name in enumerate(quoted)
        )
        text = f'<robot name="r"><link name="root"/>{links}{joints}</robot>'
    else:
        bodies = "".join(f'<body name={name}><joint/><geom size="1"/></body>' for name in quoted)
        text = f'<mujoco><worldbody><body name="root"><geom size="1"/>{bodies}</body></worldbody></mujoco>'
    morphology = read(Description("r", f"r.{form}", form, text.encode()))  # type: ignore[arg-type]
    assert [limb.name for limb in morphology.limbs[1:]] == list(NAMES)
    for naming in ("raw", "canonical"):
        spec = token_spec(morphology, naming=naming)  # type: ignore[arg-type]
        assert len({token.name for token in spec.sensors}) == len(spec.sensors)
        json.loads(spec.to_json())


@pytest.mark.parametrize("text", ["<mujoco/>", '<mujoco model="é"><worldbody><body name="é"/></worldbody></mujoco>'])
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-32", "cp037", "latin-1", "shift-jis", "utf-7"])
def test_wrong_encodings_are_results_or_errors(tmp_path: Path, text: str, encoding: str) -> None:
    (tmp_path / "r.xml").write_bytes(text.encode(encoding, "ignore"))
    message = "r.xml"
    try:
        read(load(tmp_path / "r.xml"))
    except MorphkitError as error:
        message = str(error)
    assert "r.xml" in message


@pytest.mark.parametrize("first", ["a", "b"])
def test_models_that_attach_each_other(tmp_path: Path, first: str) -> None:
    """MuJoCo follows them until its stack ends, and the process with it."""
    for name, other in (("a", "b"), ("b", "a")):
        more = f'<asset><model name="m" file="{other}.xml"/></asset>'
        source = mjcf(BODY.format('<attach model="m" body="a" prefix="x"/>'), more).source
        (tmp_path / f"{name}.xml").write_bytes(source)
    with pytest.raises(DescriptionError, match="attaches itself"):
        read(load(tmp_path / f"{first}.xml"))


@pytest.mark.parametrize(
    ("part", "error", "words"),
    [
        ('<mujoco><include file="/etc/passwd"/></mujoco>', AssetError, "refused"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', DescriptionError, "document type"),
        (
            '<mujoco><worldbody><replicate count="99999999"><body/></replicate></worldbody></mujoco>',
            DescriptionError,
            "limit",
        ),
        (None, AssetError, "not found"),
    ],
)
def test_attached_models_are_looked_at_first(
    tmp_path: Path, part: str | None, error: type[Exception], words: str
) -> None:
    if part is not None:
        (tmp_path / "part.xml").write_text(part)
    more = '<asset><model name="m" file="part.xml"/></asset>'
    with pytest.raises(error, match=words):
        read(mjcf(BODY.format('<attach model="m" body="a" prefix="x"/>'), more, tmp_path))


@pytest.mark.parametrize(
    "reference", ["../secret.stl", "/etc/passwd", "link.stl", "file:///etc/passwd", "x/../../secret.stl"]
)
def test_meshes_outside_are_findings_not_failures(tmp_path: Path, reference: str) -> None:
    folder = tmp_path / "robot"
    folder.mkdir()
    (tmp_path / "secret.stl").write_bytes(b"solid")
    (folder / "link.stl").symlink_to(tmp_path / "secret.stl")
    mesh = f'<link name="a"><visual><geometry><mesh filename="{reference}"/></geometry></visual></link>'
    (folder / "r.urdf").write_text(f'<robot name="r">{mesh}</robot>')
    robot = load(folder / "r.urdf")
    assert len(token_spec(read(robot)).sensors) == 19
    (mention,) = mentions(document_of(robot).root)
    asset = find_asset(mention.reference, robot)
    assert asset.path is None
    assert asset.problem
