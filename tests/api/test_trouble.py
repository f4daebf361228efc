"""What goes wrong with people and programs: odd names, large bodies, old addresses."""

import csv
import io
import json
from datetime import UTC, datetime

import pytest

from eigenfail.values.episode import Outcome

CAMPAIGNS = "/api/v1/campaigns"
HTML = {"Accept": "text/html"}
TEN_MB = 10_000_000
MARKUP = "</title><script>alert(1)</script><img src=x onerror=alert(2)>"


@pytest.mark.fault(
    "markup in names, formulas in exported tables",
    group="api",
    outcome="They are shown and exported as text.",
)
@pytest.mark.parametrize(
    "path", ["/", "/campaigns/{}", "/campaigns/{}/measures", "/comparison?a={0}&b={1}", "/suites"]
)
def test_markup_in_a_name_is_text_on_every_page(http, fields, deliver, result, path):
    made, other = (
        http.post(CAMPAIGNS, json={**fields, "name": MARKUP, "seed": seed}).json()["id"]
        for seed in (1, 2)
    )
    deliver(made, result(0), result(1, Outcome.COLLISION))
    page = http.get(path.format(made, other), headers=HTML)
    assert page.status_code == 200, page.text
    assert "<script>alert" not in page.text
    assert "<img src=x" not in page.text


@pytest.mark.fault("markup in names, formulas in exported tables")
def test_markup_in_an_address_is_text(http):
    page = http.get("/nothing/<script>alert(1)</script>", headers=HTML)
    assert page.status_code == 404
    assert "<script>alert" not in page.text


@pytest.mark.fault("markup in names, formulas in exported tables")
@pytest.mark.parametrize("sign", ["=", "+", "-", "@", "\t", "\r"])
def test_a_table_has_no_formula(http, campaign, deliver, failed, sign):
    wrong = failed(0)
    fault = type(wrong.fault)(wrong.fault.kind, f"{sign}cmd|' /C calc'!A0")
    deliver(campaign, type(wrong)(**{**fields_of(wrong), "fault": fault}))
    text = http.get(f"{CAMPAIGNS}/{campaign}/episodes.csv").text
    cells = [cell for row in csv.reader(io.StringIO(text)) for cell in row]
    assert any("calc" in cell for cell in cells)
    assert not [cell for cell in cells if "calc" in cell and cell[0] in "=+-@\t\r"]


def fields_of(struct):
    return {name: getattr(struct, name) for name in struct.__struct_fields__}


@pytest.mark.fault("body that is malformed, deeply nested or too large")
@pytest.mark.parametrize("path", ["", "/check", "/bulk", "/1/clone", "/1/analyses"])
def test_a_body_of_ten_megabytes_is_refused_in_words(http, problem, campaign, path):
    told = problem(http.post(CAMPAIGNS + path, json={"name": "n" * TEN_MB}), 413)
    assert "larger than 1000000 bytes" in told["detail"]


@pytest.mark.fault("body that is malformed, deeply nested or too large")
def test_a_field_of_a_megabyte_is_refused_by_its_name(http, problem, fields):
    told = problem(http.post(CAMPAIGNS, json={**fields, "name": "n" * 900_000}), 422)
    assert told["field"] == "name"
    assert len(json.dumps(told)) < 1000


def test_pages_tell_times_in_utc(http, store, campaign):
    page = http.get(f"/campaigns/{campaign}", headers=HTML).text
    assert "all times in UTC" in page
    created = datetime.fromtimestamp(store.campaigns.get(campaign).created_ms / 1000, UTC)
    assert f"{created:%Y-%m-%d %H:%M}" in page
