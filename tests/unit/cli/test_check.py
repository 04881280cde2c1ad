"""`morphkit check`: what it prints, and its exit codes."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from morphkit_cli.main import run

BAD = """<robot name="bad">
<link name="base"/>
<link name="leg"><inertial><mass value="-1"/></inertial></link>
<joint name="hip" type="revolute"><parent link="bse"/><child link="leg"/><limit lower="2" upper="1"/></joint>
</robot>
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.urdf").write_text(BAD)
    return tmp_path


def test_errors_come_first_with_their_places(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "bad.urdf"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ["error", "bad.urdf:3", "mass-negative"]
    assert "did you mean 'base'?" in lines[1]
    severities = [line.split()[0] for line in lines[:5]]
    assert severities == sorted(severities, key=["error", "warning"].index)
    assert lines[-1].strip() == "bad.urdf: 3 errors, 3 warnings"


def test_severity_leaves_out_the_rest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "bad.urdf", "--severity", "error"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].strip() == "bad.urdf: 3 errors"


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "bad.urdf", "quadruped", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    bad, good = told["files"]
    assert (bad["errors"], bad["warnings"], bad["infos"]) == (3, 3, 0)
    assert {"id", "severity", "file", "line", "message", "why", "fix", "element"} == set(bad["findings"][0])
    assert (good["file"], good["format"], good["findings"]) == ("quadruped.urdf", "urdf", [])


def test_good_file_is_fine(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "quadruped", "--quick"]) == 0
    assert capsys.readouterr().out.strip() == "quadruped.urdf: no findings"


def test_sarif_is_written(folder: Path) -> None:
    assert run(["check", "bad.urdf", "--sarif", "out.sarif"]) == 1
    (result, *_) = json.loads((folder / "out.sarif").read_text())["runs"][0]["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "bad.urdf"


@pytest.mark.parametrize("arguments", [["--format", "sarif"], ["--sarif", "-"], ["--format", "sarif", "--sarif", "-"]])
def test_sarif_is_printed(folder: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "bad.urdf", *arguments]) == 1
    printed = capsys.readouterr().out
    assert len(json.loads(printed)["runs"][0]["results"]) == 6
    assert [path.name for path in folder.iterdir()] == ["bad.urdf"]
    assert run(["check", "bad.urdf", "--sarif", "out.sarif"]) == 1
    assert (folder / "out.sarif").read_text() == printed


def test_format_and_file_go_together(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "bad.urdf", "--format", "json", "--sarif", "out.sarif"]) == 1
    printed = capsys.readouterr().out
    assert (folder / "out.sarif").is_file()
    assert run(["check", "bad.urdf", "--json"]) == 1
    assert capsys.readouterr().out == printed
    assert run(["check", "bad.urdf", "--format", "text"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].strip() == "bad.urdf: 3 errors, 3 warnings"


def test_explain(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--explain", "limit-inverted"]) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["limit-inverted", "error"]
    assert run(["check", "--explain", "limit-invertd"]) == 2
    assert "did you mean 'limit-inverted'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "say which files"),
        (["bad.urdf", "--explain", "cycle"], "takes no files"),
        (["--explain", "cycle", "--format", "sarif"], "takes no files"),
        (["bad.urdf", "--json", "--sarif", "-"], "only one of json and sarif"),
        (["bad.urdf", "--json", "--format", "text"], "only one of json and text"),
        (["no.urdf"], "no such file"),
        (["."], "directory"),
        (["cheetah_3_balanced"], "morphkit ablate"),
        (["bad.urdf", "--package", "x"], "NAME=DIR"),
    ],
)
def test_wrong_usage(arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", *arguments]) == 2
    assert expected.lower() in capsys.readouterr().err.lower()


def test_other_files_are_checked_where_one_cannot_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "no.urdf", "bad.urdf"]) == 2
    captured = capsys.readouterr()
    assert "bad.urdf: 3 errors" in captured.out
    assert captured.err.startswith("error: no.urdf")


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (b"", "xml-malformed"),
        (b"\0\1\2", "xml-malformed"),
        (b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>', "xml-malformed"),
        (b"<robot>" * 10_000, "xml-malformed"),
        ("<robot><link name='\U0001f916 \" x'/></robot>".encode(), "name-characters"),
        (b'<robot><link name="a"><visual><geometry><mesh filename="/etc/passwd"/></geometry></visual></link></robot>',
         "file-outside"),
    ],
)  # fmt: skip
def test_hostile_files_are_findings(
    content: bytes, rule: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "odd.urdf").write_bytes(content)
    assert run(["check", "odd.urdf", "--json"]) in (0, 1)
    (report,) = json.loads(capsys.readouterr().out)["files"]
    assert rule in [found["id"] for found in report["findings"]]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipe_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(folder / "pipe.urdf")
    assert run(["check", "pipe.urdf"]) == 2
    assert "no regular file" in capsys.readouterr().err
