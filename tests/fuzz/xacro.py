"""xacro files that try to read, write or run what they must not; what is looked for is a secret that came out."""

from __future__ import annotations

import os
from pathlib import Path
from unittest import mock

from hypothesis import strategies as st

from morphkit.errors import MorphkitError
from morphkit.registry import load
from tests.support.forked_xacro import forked

SECRET = "hush-7f31c0"
_ROBOT = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}<link name="base"/></robot>'
_EXPRESSIONS = (
    "().__class__.__base__.__subclasses__()", "(lambda: ().__class__.__mro__)()", "(lambda: 1)()", "__import__('os')",
    "(x for x in (1,)).gi_frame.f_back.f_globals", "[x.__class__ for x in (1,)]", "load_yaml.__globals__['os'].environ",
    "f.format(load_yaml)", "str.format(f, load_yaml)", "f.format_map(dict(x=1))",
    "list(map(str.format, [f], [load_yaml]))",
    "python.vars(python.type(1))", "python.vars(xacro)", "python.type('A', (), dict(__getitem__=print))",
    "python.type(1).mro()", "load_yaml('../secret.yaml')", "load_yaml('link.yaml')", "load_yaml('SECRETS/secret.yaml')",
    "load_yaml('/proc/self/environ')", "xacro.load_yaml(xacro.abs_filename('../secret.yaml'))", "(y := load_yaml)",
    "math.__loader__", "xacro.arg.__globals__", "dict.fromkeys.__self__", "open('../secret.yaml').read()",
    "load_yaml('conf.yaml')", "load_yaml('..//robot/../secret.yaml')", "python.getattr(1, 'real')", "math.root",
    "math.parent", "1 .__class__", "(1).real", "math.pi", "load_yaml", "xacro", "python", "[].append.__self__",
)  # fmt: skip
_WRAPPERS = (
    "{}", "[{}]", "({}, 1)[0]", "[{} for x in (1,)]", "dict(a={})['a']", "({} if True else 0)", "str({})", "len([{}])",
    "(lambda x={}: x)()", "[y for y in [{}]][0]", "'%s' % ({},)", "list(map(str, [{}]))", "sorted([{}], key=str)",
    "python.list(python.enumerate([{}]))", "max([{}], key=lambda e: e)", "dotify(dict(a={}))", "not {}", "({}, )",
)  # fmt: skip
_TEXTS = (
    "$(optenv MORPHKIT_SECRET)", "$(env MORPHKIT_SECRET)", "$(optenv MORPHKIT_SECRET a)", "$(find secrets)/secret.yaml",
    "$(eval optenv(${q}))", "$(eval env('MORPHKIT_SECRET'))", "$(eval ${c})", "$(eval ${d})", "$(cwd)", "$(dirname)",
    "$(eval arg('MORPHKIT_SECRET'))", "$(eval ''.__class__", "$(arg MORPHKIT_SECRET)", "$(eval ${e})", "$$(env HOME)",
)  # fmt: skip
_PLACES = (
    '<link name="a{}"/>', "<material>{}</material>", '<xacro:property name="p" value="{}"/><link name="b${{p}}"/>',
    '<xacro:macro name="m" params="x:={}"><link name="c${{x}}"/></xacro:macro><xacro:m/>', "<!-- {} -->",
    '<xacro:if value="{}"><link name="d"/></xacro:if>', '<xacro:include filename="{}"/>',
    '<!-- xacro:eval-comments:on --><!-- {} -->', '<xacro:element xacro:name="{}"/>', '<xacro:call macro="{}"/>',
    '<xacro:arg name="z" default="{}"/><link name="e$(arg z)"/>', '<xacro:attribute name="name" value="{}"/>',
)  # fmt: skip
_WHOLE = (
    '<xacro:include filename="../secret.xacro"/>', '<xacro:include filename="link.xacro"/>',
    '<xacro:include filename="../*.xacro"/>', '<xacro:include filename="*/*"/>',
    '<xacro:include filename="own.xacro"/>',
    '<xacro:include filename="$(find secrets)/secret.yaml"/>', '<xacro:include filename="SECRETS/secret.xacro"/>',
    '<xacro:include filename="/proc/self/environ" optional="true"/>', '<xacro:include filename="r.xacro"/>',
    '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', '<xacro:include filename="dtd.xacro"/>',
    '<xacro:property name="p" value="${p}"/>${p}', '<xacro:include filename=""/>', '<xacro:include/>',
)  # fmt: skip
_PROPERTIES = (
    """<xacro:property name="c" value="open('../secret.yaml').read()"/>"""
    """<xacro:property name="q" value="'MORPHKIT_SECRET'"/>"""
    """<xacro:property name="f" value="{0.__globals__[os].environ}"/>"""
    """<xacro:property name="d" value="__import__('os').environ"/>"""
    """<xacro:property name="e" value="getattr(str, 'form' + 'at')('{0.__class__}', 1)"/>"""
)
_BESIDE = {
    "conf.yaml": b"a: 1",
    "own.xacro": _ROBOT.format("").encode(),
    "dtd.xacro": '<!DOCTYPE r [<!ENTITY s SYSTEM "../secret.yaml">]><robot>&s;</robot>'.encode("utf-16"),
}


@st.composite
def examples(draw: st.DrawFn) -> dict[str, bytes]:
    """A xacro file of one to three attacks, each hidden a little."""
    attacks = []
    for _ in range(draw(st.integers(1, 3))):
        expression = draw(st.sampled_from(_EXPRESSIONS))
        for _ in range(draw(st.sampled_from((0, 1, 1, 2)))):
            expression = draw(st.sampled_from(_WRAPPERS)).format(expression)
        text = draw(st.one_of(st.just("${" + expression + "}"), st.sampled_from(_TEXTS)))
        place = draw(st.sampled_from(_PLACES)).format(text.replace("&", "&amp;").replace("<", "&lt;"))
        attacks.append(draw(st.one_of(st.just(place), st.sampled_from(_WHOLE))))
    return {**_BESIDE, "r.xacro": _ROBOT.format(_PROPERTIES + "".join(attacks)).encode()}


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Expand it next to a secret; nothing of that may come out, and nothing may change."""
    robot, secrets = folder / "robot", folder / "secrets"
    for made in (robot, secrets):
        made.mkdir(exist_ok=True)
    for place in (folder, secrets):
        (place / "secret.yaml").write_text(SECRET)
        (place / "secret.xacro").write_text(_ROBOT.format(f'<link name="{SECRET}"/>'))
    for name, content in files.items():
        (robot / name).write_bytes(content.replace(b"SECRETS", str(secrets).encode()))
    for suffix in ("yaml", "xacro"):
        link = robot / f"link.{suffix}"
        if not link.is_symlink():
            link.symlink_to(f"../secret.{suffix}")
    before = sorted(folder.rglob("*"))
    with mock.patch.dict(os.environ, MORPHKIT_SECRET=SECRET), forked():
        try:
            made, end = load(robot / "r.xacro").source.decode(), "expanded"
        except MorphkitError as error:
            made, end = str(error), "refused"
    assert made.strip()
    assert SECRET not in made, made
    assert sorted(folder.rglob("*")) == before
    return end
