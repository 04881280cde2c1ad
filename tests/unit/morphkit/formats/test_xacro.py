"""What a xacro file can read and run, and that honest ones are expanded as ever."""

import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from morphkit.errors import DependencyError, DescriptionError
from morphkit.formats.xacro_expressions import RefusedError, check_expression
from morphkit.registry import load
from morphkit_cli.main import run
from tests.fuzz import xacro as attack

pytest.importorskip("xacro")
ROBOT = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}<link name="base"/></robot>'
RUNS = (
    '<xacro:property name="c" value="open(\'{}\', \'w\')"/><link name="$(eval ${{c}})"/>',
    '<link name="${{(lambda: [c for c in ().__class__.__base__.__subclasses__() if c.__name__ == '
    "'_wrap_close'][0].__init__.__globals__['system']('touch {}'))()}}\"/>",
    '<link name="${{[x.__class__.__base__.__subclasses__() for x in [1]]}}"/>',
    "<link name=\"${{python.vars(python.type(python.type(1)))['__subclasses__'](python.type(1).mro()[1])}}\"/>",
    '<link name="${{(x for x in [1]).gi_frame}}"/>',
    '<xacro:property name="f" value="{{0.__globals__}}"/><link name="${{f.format(load_yaml)}}"/>',
    '<xacro:property name="f" value="{{0.__globals__}}"/><link name="${{list(map(str.format, [f], [load_yaml]))}}"/>',
)


def write(folder: Path, body: str, name: str = "r.xacro") -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(ROBOT.format(body))
    return file


@pytest.mark.parametrize("body", RUNS)
@pytest.mark.parametrize("command", ["tokens", "check"])
def test_code_is_not_run(tmp_path: Path, body: str, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    robot = write(tmp_path, body.format(tmp_path / "owned"))
    assert run([command, str(robot)]) == (1 if command == "check" else 2)
    said = capsys.readouterr()
    assert "--trust-xacro" in said.out + said.err
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize("body", RUNS[:2])
def test_a_trusted_file_runs_what_it_says(tmp_path: Path, body: str) -> None:
    robot = write(tmp_path, body.format(tmp_path / "owned"))
    load(robot, trust_xacro=True)
    assert (tmp_path / "owned").exists()


@pytest.mark.parametrize(
    "body",
    [
        "<link name=\"${load_yaml('../secret.yaml')}\"/>",
        "<link name=\"${load_yaml('link.yaml')}\"/>",
        "<link name=\"${load_yaml('SECRETS/secret.yaml')}\"/>",
        '<link name="$(optenv MORPHKIT_SECRET)"/>',
        '<link name="$(env MORPHKIT_SECRET)"/>',
        "<link name=\"$(eval optenv('MORPHKIT_SECRET'))\"/>",
        '<xacro:include filename="../secret.xacro"/>',
        '<xacro:include filename="../*.xacro"/>',
        '<xacro:include filename="link.xacro"/>',
        '<xacro:include filename="link.xacro" optional="true"/>',
        '<xacro:include filename="$(find secrets)/secret.yaml"/>',
        '<xacro:property name="c" value="open(\'SECRETS/secret.yaml\').read()"/><link name="$(eval ${c})"/>',
    ],
)
def test_secrets_stay_where_they_are(tmp_path: Path, body: str) -> None:
    # The body is tried with the secret around it; it raises where that comes out.
    assert attack.attempt({"r.xacro": ROBOT.format(body).encode()}, tmp_path) == "refused" or "*" in body


def test_the_attack_finds_what_leaks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attack, "load", lambda path: load(path, trust_xacro=True))
    body = "<link name=\"${load_yaml('../secret.yaml')}\"/>"
    with pytest.raises(AssertionError, match=attack.SECRET):
        attack.attempt({"r.xacro": ROBOT.format(body).encode()}, tmp_path)


@settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(files=attack.examples())
def test_composed_attacks(tmp_path_factory: pytest.TempPathFactory, files: dict[str, bytes]) -> None:
    attack.attempt(files, tmp_path_factory.mktemp("attack"))


def test_what_a_refusal_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = write(tmp_path, "<link name=\"${load_yaml('/etc/passwd')}\"/>")
    with pytest.raises(DescriptionError) as caught:
        load(robot)
    assert str(caught.value) == (
        f"{robot}: cannot be expanded by xacro: /etc/passwd, a file outside of its packages (--package NAME=DIR adds"
        " one), is refused; if you trust the file, say so with --trust-xacro"
    )
    robot = write(tmp_path, '<link name="$(optenv SIDE left)"/>')
    assert '<link name="left"/>' in load(robot).source.decode()
    monkeypatch.setenv("SIDE", "right")
    with pytest.raises(DescriptionError, match=r"variable SIDE is refused; .*--trust-xacro"):
        load(robot)
    assert '<link name="right"/>' in load(robot, trust_xacro=True).source.decode()


def test_the_hint_in_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = str(write(tmp_path, "<!-- ${1} --><material name=\"${load_yaml('/etc/hostname')}\"/>"))
    assert run(["check", robot]) == 1
    assert "Say --trust-xacro, if you trust the file." in capsys.readouterr().out
    assert run(["check", robot, "--trust-xacro"]) == 0


def test_honest_files_are_expanded(tmp_path: Path) -> None:
    package, other = tmp_path / "ws" / "arm", tmp_path / "ws" / "tools"
    for folder in (package, other):
        folder.mkdir(parents=True)
        (folder / "package.xml").write_text("<package/>")
    (package / "config.yaml").write_text("arm: {length: !degrees 180, names: [a, b]}")
    write(other, '<xacro:macro name="tool"><link name="tool"/></xacro:macro>', "urdf/tool.xacro")
    write(package, '<link name="more"/>', "parts/more.xacro")
    robot = write(
        package,
        """<xacro:include filename="$(find tools)/urdf/tool.xacro"/><xacro:include filename="../parts/m*.xacro"/>
        <xacro:property name="c" value="${load_yaml('../config.yaml')}"/>
        <xacro:arg name="side" default="left"/><xacro:property name="a" value="arg('side')"/>
        <xacro:property name="s" value="$(arg side)"/>
        <link name="l ${round(c.arm.length, 3)} ${c['arm']['names'][1]} ${[x * 2 for x in [1, 2]][-1]} ${s.upper()[:2]}
        ${'%d' % (python.len(s) + 1)} ${s + '!'} ${dict(a=1)['a'] if s != 'x' else 0} ${radians(180) == pi}
        $(eval 2 ** 3) ${sorted(python.set([3, 1]))} ${max(map(float, ['1', '2']))} $(eval ${a})"/><xacro:tool/>""",
        "urdf/r.xacro",
    )
    source = load(robot).source.decode()
    name = source.partition('<link name="l ')[2].partition('"')[0].split()
    assert name == ["3.142", "b", "4", "LE", "5", "left!", "1", "True", "8", "[1,", "3]", "2.0", "left"]
    assert '<link name="tool"/>' in source
    assert '<link name="more"/>' in source
    assert str(tmp_path) not in source


def test_a_workspace_of_links_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, share = tmp_path / "src" / "arm", tmp_path / "install" / "share" / "arm"
    write(source, '<xacro:include filename="part.xacro"/>')
    write(source, '<link name="part"/>', "part.xacro")
    share.mkdir(parents=True)
    (share / "package.xml").write_text("<package/>")
    for name in ("r.xacro", "part.xacro"):
        (share / name).symlink_to(source / name)
    assert '<link name="part"/>' in load(share / "r.xacro").source.decode()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    robot = write(tmp_path / "else", '<xacro:include filename="$(find arm)/part.xacro"/>')
    assert '<link name="part"/>' in load(robot).source.decode()


@pytest.mark.parametrize(
    "text",
    ["lambda: 1", "(x for x in y)", "a.__b", "a._b", "[x._b for x in y]", "f'{a.__b}'", "__x", "(a := 1)", "a.format"],
)
def test_refused_expressions(text: str) -> None:
    with pytest.raises(RefusedError):
        check_expression(text)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has it")
def test_the_library_that_confines_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "seccompy" else name)
    with pytest.raises(DependencyError, match=r"not installed \(seccompy\): pip install 'morphkit\[xacro\]'"):
        load(write(tmp_path, ""))
