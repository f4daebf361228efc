"""HEAD, ETags, and the forms of bodies and answers."""

import json

import pytest

CAMPAIGNS = "/api/v1/campaigns"


@pytest.mark.parametrize("path", ["", "/1", "/1/episodes", "/1/summary", "/9"])
def test_head_is_get_without_a_body(http, campaign, path):
    got, head = http.get(CAMPAIGNS + path), http.head(CAMPAIGNS + path)
    assert head.status_code == got.status_code
    assert head.content == b""
    assert head.headers == got.headers


def test_head_of_a_page(http, campaign):
    head = http.head(f"/campaigns/{campaign}")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"].startswith("text/html")


def test_head_of_a_stream_ends(http):
    head = http.head("/api/v1/events")
    assert head.status_code == 200
    assert head.headers["content-type"].startswith("text/event-stream")


def test_what_has_not_changed_is_not_sent_again(http, store, campaign):
    first = http.get(f"{CAMPAIGNS}/{campaign}")
    tag = first.headers["etag"]
    for known in (tag, f'"other", W/{tag}', "*"):
        again = http.get(f"{CAMPAIGNS}/{campaign}", headers={"If-None-Match": known})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == tag
    store.campaigns.move(campaign, "running")
    changed = http.get(f"{CAMPAIGNS}/{campaign}", headers={"If-None-Match": tag})
    assert changed.status_code == 200
    assert changed.json()["state"] == "running"
    assert changed.headers["etag"] != tag


def test_an_etag_is_for_answers_alone(http):
    for path in (f"{CAMPAIGNS}/9", "/", "/metrics"):
        response = http.get(path, headers={"If-None-Match": "*"})
        assert response.status_code != 304
        assert response.content


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"]
)
def test_a_body_of_another_kind_is_refused(http, problem, fields, kind):
    body = json.dumps(fields)
    told = problem(http.post(CAMPAIGNS, content=body, headers={"Content-Type": kind}), 415)
    assert "application/json" in told["detail"]


@pytest.mark.parametrize("kind", ["application/json", "Application/JSON; charset=utf-8", ""])
def test_json_is_read_under_each_of_its_names(http, fields, kind):
    sent = {"Content-Type": kind} if kind else {}
    response = http.post(CAMPAIGNS, content=json.dumps(fields), headers=sent)
    assert response.status_code == 201


@pytest.mark.parametrize(
    ("path", "accept", "written"),
    [
        ("/api/v1/methods", "text/csv", "application/json"),
        ("/api/v1/methods", "application/xml, text/*;q=0.5", "application/json"),
        ("/api/v1/events", "application/json", "text/event-stream"),
    ],
)
def test_what_cannot_be_written_is_refused(*, http, problem, path, accept, written):
    told = problem(http.get(path, headers={"Accept": accept}), 406)
    assert written in told["detail"]


@pytest.mark.parametrize(
    "accept", ["*/*", "application/*", "text/html, */*;q=0.8", "text/x, application/json;q=0.1"]
)
def test_json_is_written_for_whoever_takes_it(http, accept):
    assert http.get("/api/v1/events/list", headers={"Accept": accept}).status_code == 200


def test_a_proof_tells_where_it_can_be_read(http, deliver, campaign, result, finished):
    analysis = finished()
    response = http.post(f"/api/v1/analyses/{analysis}/proof", json={})
    assert response.status_code == 202
    assert http.get(response.headers["Location"]).status_code == 200
