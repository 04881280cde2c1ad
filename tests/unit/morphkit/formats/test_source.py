from __future__ import annotations

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.formats.document import Document
from morphkit.formats.source import Source

KEY = b"""<mujoco>
  <key name='stand'
    qpos="
      0 0 1
      1 0 0 0

      .1 .2
      .3 .4"
    ctrl="1 2"/>
</mujoco>
"""


def with_qpos(value: str, source: bytes = KEY) -> bytes:
    opened = Source(Document(source, file="key.xml"))
    opened.root[0].set("qpos", value)
    return opened.render()


@pytest.mark.parametrize(
    ("value", "before", "after"),
    [
        ("0 0 1 1 0 0 0 .1 .3 .4", b".1 .2", b".1"),
        ("0 0 1 1 0 0 0 .2 .3 .4", b".1 .2", b".2"),
        ("0 0 1 1 0 0 0 .3 .4", b"\n\n      .1 .2", b""),
        ("0 0 1 1 0 0 0 .1 .2", b"\n      .3 .4", b""),
        ("1 1 0 0 0 .1 .2 .3 .4", b"0 0 1\n", b"1\n"),
    ],
)
def test_an_attribute_over_several_lines_keeps_them_where_words_go(value, before, after):
    assert with_qpos(value) == KEY.replace(before, after, 1)


@pytest.mark.parametrize(
    ("words", "left", "cut"),
    [
        ("0 0 1 2 0\n0 0 3\n", "0 0 0 0 3", "0 0\n0 0 3\n"),
        ("1 2\n0 0\n0 0\n", "1 2 0 0", "1 2\n0 0\n"),
        ("0 1 0\n2 0 3\n", "0 0 2 3", "0 0\n2 3\n"),
        ("0 0\n0 0\n", "0 0 0", "0 0\n0\n"),
    ],
)
def test_of_equal_words_those_go_that_stand_beside_the_others(words, left, cut):
    source = b'<mujoco><key qpos="%s"/></mujoco>'
    opened = Source(Document(source % words.encode(), file="key.xml"))
    opened.root[0].set("qpos", left)
    assert opened.render() == source % cut.encode()


def test_an_attribute_with_new_words_is_written_on_one_line():
    assert b'\n    qpos="7 .2"\n' in with_qpos("7 .2")
    assert b'\n    qpos=".4 .1"\n' in with_qpos(".4 .1")


@pytest.mark.parametrize("end", ["/>", " />", "\n/>", "></key>", "\n></key>"])
def test_the_end_of_a_start_tag_stays_as_it_is_written(end):
    source = f'<mujoco><key name="a"\n  time="1"{end}</mujoco>'.encode()
    opened = Source(Document(source, file="key.xml"))
    opened.root[0].set("time", "2")
    assert opened.render() == source.replace(b'"1"', b'"2"')
    opened = Source(Document(source, file="key.xml"))
    opened.root[0].set("qpos", "3")
    assert opened.render() == source.replace(b'"1"', b'"1" qpos="3"')
    opened = Source(Document(source, file="key.xml"))
    opened.root[0].attrib.pop("time")
    assert opened.render() == source.replace(b'\n  time="1"', b"")


def test_windows_line_ends_stay():
    source = KEY.replace(b"\n", b"\r\n")
    assert with_qpos("0 0 1 1 0 0 0 .1 .2", source) == source.replace(b"\r\n      .3 .4", b"")


def test_the_lines_of_a_keyframe_survive_a_cut():
    source = b"""<mujoco><worldbody><body name="base">
  <body name="arm"><joint/><joint axis="1 0 0"/><geom size="1"/></body>
  <body name="leg"><joint/><geom size="1"/></body>
</body></worldbody><keyframe><key name="bent" qpos="
  .1 .2
  .3
"/></keyframe></mujoco>"""
    left = ablate(Description("r", "r.xml", "mjcf", source), remove=["arm"]).description.source
    assert left == source.replace(
        b'  <body name="arm"><joint/><joint axis="1 0 0"/><geom size="1"/></body>\n', b""
    ).replace(b"\n  .1 .2", b"")
