"""Reports over HTTP."""

import io
import zipfile

import pytest

from eigenfail.values.episode import Outcome
from eigenfail.values.summary import Summary
from eigenfail_api import concurrency
from eigenfail_reports.contents import Report

URL = "/api/v1/report"


@pytest.fixture
def searched(campaign, deliver, result):
    """A campaign with two failures in ten episodes."""
    crashes = (2, 5)
    made = (result(i, Outcome.COLLISION if i in crashes else Outcome.SAFE) for i in range(10))
    deliver(campaign, *made)
    return campaign


def test_a_report_is_a_file(http, searched):
    response = http.get(URL, params={"campaign": searched})
    assert response.status_code == 200
    assert response.headers["content-type"] == "text/html; charset=utf-8"
    assert response.headers["content-disposition"] == 'attachment; filename="report.html"'
    assert response.text.startswith("<!doctype html>")


def test_its_data_agree_with_the_summary(http, searched, read):
    report = read(http.get(URL, params={"campaign": searched, "format": "json"}), Report)
    summary = read(http.get(f"/api/v1/campaigns/{searched}/summary"), Summary)
    (results,) = [table for table in report.tables if table.name == "results"]
    row = dict(zip((column.name for column in results.columns), results.rows[0], strict=True))
    assert (row["n"], row["failures"]) == (10, 2)
    assert row["failure_rate_low"] == summary.failure_rate.interval.low
    assert row["severity"] == summary.mean_severity
    assert report.campaigns[0].id == searched


def test_the_bundle_has_all_of_it(http, searched):
    response = http.get(URL, params={"campaign": searched, "format": "zip"})
    assert response.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(response.content)) as packed:
        assert {"report.html", "report.json", "tables/results.csv"} <= set(packed.namelist())


def test_several_campaigns_keep_their_order(http, fields, searched, read):
    other = http.post("/api/v1/campaigns", json={**fields, "name": "other"}).json()["id"]
    asked = {"campaign": [other, searched], "format": "json"}
    report = read(http.get(URL, params=asked), Report)
    assert [campaign.id for campaign in report.campaigns] == [other, searched]


@pytest.mark.parametrize(
    ("asked", "status", "field"),
    [
        ({}, 422, "campaign"),
        ({"campaign": 0}, 422, None),
        ({"campaign": "x"}, 422, None),
        ({"campaign": [1, 1]}, 422, "campaign"),
        ({"campaign": list(range(1, 30))}, 422, "campaign"),
        ({"campaign": 1, "format": "pdf"}, 422, "format"),
        ({"campaign": 99}, 404, None),
        ({"campaign": 1, "colour": "red"}, 422, "query"),
    ],
)
def test_what_cannot_be_reported_is_refused(*, http, searched, problem, asked, status, field):
    told = problem(http.get(URL, params=asked), status)
    if field is not None:
        assert told["field"] == field


def test_markup_in_a_name_is_text(http, fields, deliver, result):
    markup = "<script>alert(1)</script>"
    made = http.post("/api/v1/campaigns", json={**fields, "name": markup}).json()["id"]
    deliver(made, result(0), result(1, Outcome.COLLISION))
    report = http.get(URL, params={"campaign": made})
    assert "<script>alert" not in report.text
    assert "&lt;script&gt;alert" in report.text


def test_a_campaign_of_two_releases_is_told_in_a_warning(http, store, campaign, deliver, result):
    for index, version in enumerate(("1.0.0", "1.1.0")):
        store.campaigns.begin_part(campaign, {"eigenfail": version})
        deliver(campaign, result(index))
    words = "went on with other versions after 1 result: eigenfail 1.0.0 then, 1.1.0 now."
    report = http.get(URL, params={"campaign": campaign, "format": "json"}).json()
    assert any(words in warning for warning in report["warnings"])


def test_a_crowd_is_refused(http, campaign, monkeypatch):
    monkeypatch.setattr(concurrency, "MOST_WAITING", -concurrency.MOST_RUNNING)
    refused = http.get(URL, params={"campaign": campaign})
    assert refused.status_code == 503
    assert int(refused.headers["retry-after"]) > 0
