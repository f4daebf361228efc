"""A gate as a solution of `eigenfail evidence`."""

import json

import pytest

CLAIM = '[claim]\ntext = "No failure came back."\n[[claim.solutions]]\nkind = "gate"\n'


@pytest.mark.parametrize("case", [("better", 0), ("worse", 1)])
def test_a_gate_is_compared_with_the_episodes_of_its_campaigns(
    eigenfail, baseline, suite, tmp_path, case
):
    planner, code = case
    words = ("--planner-version", "v2", "--baseline", "v1", "--json")
    report = eigenfail("gate", suite(planner), *words)
    assert report.exit_code == code, report.output
    (tmp_path / "gate.json").write_text(report.stdout)
    file, out = tmp_path / "claims.toml", tmp_path / "bundle"
    file.write_text(f'{CLAIM}file = "gate.json"\n')
    made = eigenfail("evidence", file, "--output", out, "--json")
    assert made.exit_code == code, made.output
    counts = json.loads(report.stdout)["counts"]
    found = json.loads((out / "solutions/Sn1.json").read_text())["finding"]
    assert found["figures"] == counts
    checked = eigenfail("evidence", "verify", out, "--json")
    assert checked.exit_code == 0, checked.output
    flipped = json.loads(report.stdout) | {"open": code == 1}
    (tmp_path / "gate.json").write_text(json.dumps(flipped))
    forged = eigenfail("evidence", file, "--output", out, "--force")
    assert forged.exit_code == 3
    assert "its counts are not those of its members" in forged.stdout
