"""Reports of findings: their order, number and places, as SARIF and as reference; files that cannot be checked."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from morphkit.errors import DescriptionError, UnknownNameError
from morphkit.validation.check import check
from morphkit.validation.findings import MAX_PER_RULE, find_rule, rules
from morphkit.validation.findings_page import reference
from morphkit.validation.sarif import to_sarif
from tests.support.faulty_robots import LIMIT, check_text, inertial, lines_of, mjcf, urdf


def test_findings_in_included_files(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.xml").write_text(
        '<mujocoinclude>\n<body name="leg">\n<joint name="hip" range="9 -9"/><geom size="0.1" material="red"/>\n'
        '</body><include file="parts/leg.xml"/>\n</mujocoinclude>'
    )
    body = '<body name="base"><geom size="1"/>\n<include file="parts/leg.xml"/></body>'
    text = f"<mujoco>\n<worldbody>{body}</worldbody></mujoco>"
    report = check_text(tmp_path, "r.xml", text, deep=True)
    places = {found.rule: found.place for found in report.findings}
    assert places["range-inverted"] == "parts/leg.xml:3"
    assert places["include-repeated"] == "parts/leg.xml:4"


def test_all_mistakes_are_found_at_once(tmp_path: Path) -> None:
    text = urdf(
        leg=inertial("-1"), hip='<limit lower="2" upper="1"/>', extra='<link name="leg"/><gazebo reference="x"/>'
    )
    found = {each.rule for each in check_text(tmp_path, "r.urdf", text, deep=False).findings}
    assert {"mass-negative", "limit-inverted", "effort-missing", "name-duplicate", "reference-ignored"} <= found


def test_worst_come_first(tmp_path: Path) -> None:
    text = urdf(hip='<limit lower="2" upper="1" effort="0" velocity="0"/>')
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert [found.severity for found in report.findings] == ["error", "warning", "info"]


def test_crash_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text("import os, sys\nif 'sandbox' in ' '.join(sys.orig_argv): os.abort()\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path) + os.pathsep + os.environ.get("PYTHONPATH", ""))
    report = check_text(tmp_path, "r.xml", mjcf(), deep=True)
    assert [(found.rule, found.message) for found in report.findings] == [("simulator-crash", "MuJoCo: signal 6")]


def test_many_findings_are_counted_not_listed(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{number}"/>' for number in range(10)) * 40
    report = check_text(tmp_path, "r.urdf", f"<robot>{links}</robot>", deep=False)
    assert len(lines_of(report, "name-duplicate")) == 10  # those that say the same count once
    spread = f"<robot>{links}</robot>".replace("><", ">\n<")
    report = check_text(tmp_path, "r.urdf", spread, deep=False)
    assert len(lines_of(report, "name-duplicate")) == MAX_PER_RULE
    assert report.count("error") == 1 + 390


def test_unreadable_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"no\.urdf: cannot be read"):
        check(tmp_path / "no.urdf")
    with pytest.raises(DescriptionError, match="directory"):
        check(tmp_path)


def test_unknown_rule_has_a_hint() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'limit-inverted'"):
        find_rule("limit-invertd")


def test_sarif_has_what_the_schema_requires(tmp_path: Path) -> None:
    report = check_text(tmp_path, "odd name.urdf", urdf(hip=LIMIT.replace("-1", "3")), deep=False)
    log = json.loads(json.dumps(to_sarif([report])))
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    driver = run["tool"]["driver"]
    assert driver["name"]
    known = [rule["id"] for rule in driver["rules"]]
    assert len(set(known)) == len(known) == len(rules())
    for rule in driver["rules"]:
        assert rule["defaultConfiguration"]["level"] in ("error", "warning", "note")
        assert all(rule[part]["text"] for part in ("shortDescription", "fullDescription", "help"))
    (result,) = run["results"]
    assert result["message"]["text"]
    assert known[result["ruleIndex"]] == result["ruleId"] == "limit-inverted"
    assert result["level"] == "error"
    place = result["locations"][0]["physicalLocation"]
    assert place == {"artifactLocation": {"uri": "odd%20name.urdf"}, "region": {"startLine": 4}}


def test_reference_is_made_of_the_rules() -> None:
    page = Path(__file__).parents[4] / "docs" / "findings.md"
    assert page.read_text("utf-8") == reference(), "python -m morphkit.validation.findings_page > docs/findings.md"
