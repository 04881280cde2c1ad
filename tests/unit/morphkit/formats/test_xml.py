from __future__ import annotations

import copy

import pytest

from morphkit.errors import DescriptionError
from morphkit.formats import xml

BODY = b'<mujoco model="m">\n  <!-- kept -->\n  <worldbody/>\n  <size note="&lt;a&gt;"/>\n</mujoco>'
LAUGHS = b"""<?xml version="1.0"?>
<!-- innocent -->
<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>
<robot name="&c;"><link name="a">&c;</link></robot>"""
EXTERNAL = b'<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="r">&x;</robot>'


@pytest.mark.parametrize(
    ("source", "line", "words"),
    [
        (b"", 1, "empty"),
        (b" \n\t\n", 1, "empty"),
        (b"\xef\xbb\xbf", 1, "empty"),
        (b"hello\nworld", 1, "not well-formed"),
        (b"<robot>\n<link>\n</robot>", 3, "not well-formed"),
        (b"<robot/>\n<robot/>", 2, "not well-formed"),
        (b"<robot>\n\xff</robot>", 2, "not well-formed"),
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', 1, "encoding"),
        (b"<robot>\n\n\0</robot>", 3, "NUL"),
        (b"\x7fELF\x02\x01\x01\0\0", 1, "NUL"),
        (LAUGHS, 3, "DOCTYPE"),
        (EXTERNAL, 1, "DOCTYPE"),
        ("<!DOCTYPE robot><robot/>".encode("utf-16"), 1, "DOCTYPE"),
        (b"<a>" * 300 + b"</a>" * 300, 1, "deeper than 256"),
    ],
)
def test_refuses_what_is_no_plain_xml(source: bytes, line: int, words: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        xml.parse(source, file="bad.xml")
    assert str(caught.value).startswith(f"bad.xml:{line}: ")
    assert words in str(caught.value)


def test_refuses_more_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml, "MAX_BYTES", 100)
    with pytest.raises(DescriptionError, match=r"big\.xml: .* more than the limit"):
        xml.parse(b"<robot>" + b" " * 100 + b"</robot>", file="big.xml")


def test_a_comment_may_speak_of_doctype() -> None:
    tree = xml.parse(b"<!-- no <!DOCTYPE x> here --><robot/>", file="a.urdf")
    assert tree.getroot().tag == "robot"


@pytest.mark.parametrize(
    "source",
    [
        BODY,
        BODY + b"\n",
        b'<?xml version="1.0"?>\n' + BODY + b"\n\n",
        b"<?xml version='1.0' encoding='UTF-8' standalone='yes'?>\n\n<!-- license -->\n<?pi x?>\n" + BODY,
        BODY + b"\n<!-- after </mujoco> -->\n<?pi y?>\n",
        b"\xef\xbb\xbf" + BODY,
        BODY.replace(b"\n", b"\r\n"),
        b'<?xml version="1.0" encoding="ISO-8859-1"?>\n<robot name="\xe9"/>\n',
        '<robot name="é"><link name="漢"/></robot>'.encode(),
        b"<robot><a><![CDATA[x < y]]></a>\n</robot>\n",
        b'<robot>\n<limit drake:acceleration="1">\n<a:b/></limit></robot>\n',
        b'<?xml version="0.0"?>\n<robot name="r"/>\n',
    ],
)
def test_round_trip_gives_the_same_bytes(source: bytes) -> None:
    tree = xml.parse(source, file="a.xml")
    assert xml.serialize(tree) == source
    assert xml.serialize(copy.deepcopy(tree)) == source


def test_utf16_survives_a_round_trip() -> None:
    source = '<robot name="é"/>'.encode("utf-16")
    again = xml.parse(xml.serialize(xml.parse(source, file="a")), file="a")
    assert again.getroot().get("name") == "é"


def test_leniency_ends_with_prefixes_and_versions() -> None:
    tree = xml.parse(b"<robot>\n<drake:a>\n<link/></drake:a></robot>", file="a.urdf")
    assert [node.tag for node in tree.iter()] == ["robot", "drake:a", "link"]
    assert tree.find(".//link").sourceline == 3
    with pytest.raises(DescriptionError, match=r"a\.urdf:3: not well-formed"):
        xml.parse(b"<robot>\n<drake:a>\n<link></drake:a></robot>", file="a.urdf")


def test_an_edit_changes_nothing_else() -> None:
    tree = xml.parse(b'<?xml version="1.0"?>\n' + BODY + b"\n", file="a.xml")
    tree.getroot().set("model", "n")
    assert xml.serialize(tree) == b'<?xml version="1.0"?>\n' + BODY.replace(b'"m"', b'"n"') + b"\n"


def test_root_format() -> None:
    assert xml.root_format(xml.parse(b"<robot/>", file="a"), file="a") == "urdf"
    assert xml.root_format(xml.parse(b"<mujoco/>", file="a"), file="a") == "mjcf"
    for source, words in (
        (b"\n<sdf/>", "convert it"),
        (b"\n<mujocoinclude/>", "part of"),
        (b"\n<r xmlns='x'/>", "xmlns"),
    ):
        with pytest.raises(DescriptionError, match=rf"a\.xml:2: root element .*{words}"):
            xml.root_format(xml.parse(source, file="a.xml"), file="a.xml")
