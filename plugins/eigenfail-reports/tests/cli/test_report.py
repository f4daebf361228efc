"""`eigenfail report`."""

import json

import pytest

from eigenfail.wire.http import decode
from eigenfail_reports.contents import Report


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def test_a_report_is_written_and_said_where(eigenfail, done, out):
    told = eigenfail("report", done, "-o", out)
    assert told.exit_code == 0, told.output
    assert "report.html" in told.stdout
    report = decode((out / "report.json").read_bytes(), Report)
    assert report.command == f"eigenfail report {done}"
    assert (out / "report.html").read_text().count("<section") == len(report.sections)


def test_as_json_it_is_the_report(eigenfail, done, out):
    told = json.loads(eigenfail("report", done, "-o", out, "--json").stdout)
    assert told["campaigns"][0]["id"] == done


def test_an_existing_report_stays_unless_forced(eigenfail, done, out):
    assert eigenfail("report", done, "-o", out).exit_code == 0
    refused = eigenfail("report", done, "-o", out)
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert eigenfail("report", done, "-o", out, "--force").exit_code == 0


def test_an_unknown_campaign_is_refused(eigenfail, done, out):
    refused = eigenfail("report", done, 99, "-o", out)
    assert refused.exit_code == 2
    assert not out.exists()
