"""Saved views and the audit log: who saved what, and who may."""

URL = "/api/v1/views"
VIEW = {"name": "hard", "page": "episodes", "query": {"sort": "-severity"}}


def test_changes_are_in_the_audit_log_with_the_name_of_the_key(as_holder, changes):
    made = as_holder("runner", "POST", URL, json=VIEW).json()
    assert made["author"] == "the runner"
    address = f"{URL}/{made['id']}"
    renamed = as_holder("admin", "PUT", address, json={**VIEW, "name": "harder"}).json()
    assert renamed["author"] == "the admin"
    assert as_holder("runner", "DELETE", address).status_code == 200
    told = [(each.who, each.method, each.subject, each.status) for each in changes()]
    assert told == [
        ("the runner", "POST", address, 201),
        ("the admin", "PUT", address, 200),
        ("the runner", "DELETE", address, 200),
    ]


def test_a_viewer_opens_views_and_changes_none(as_holder, changes):
    address = f"{URL}/{as_holder('runner', 'POST', URL, json=VIEW).json()['id']}"
    assert as_holder("viewer", "GET", address).json()["name"] == "hard"
    assert as_holder("viewer", "GET", URL).status_code == 200
    refused = [
        as_holder("viewer", method, path, json=VIEW).status_code
        for method, path in (("POST", URL), ("PUT", address), ("DELETE", address))
    ]
    assert refused == [403, 403, 403]
    assert [each.status for each in changes()] == [201, 403, 403, 403]
