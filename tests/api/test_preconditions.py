"""If-Match: a change of what is no longer what its author saw is refused."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from store_checks.modes import analysed, crashed

from eigenfail.errors import PreconditionFailed
from eigenfail.testing.examples import analysis_result

URL = "/api/v1"
CHANGES = [
    ("POST", "{mode}/triage", {"note": "seen"}, "{mode}/triage"),
    ("PUT", "{mode}/name", {"name": "late"}, "{analysis}/modes"),
    ("POST", "{campaign}/priority", {"priority": "high"}, "{campaign}"),
    ("POST", "{campaign}/cancel", None, "{campaign}"),
]


@pytest.fixture
def places(http, store, campaign):
    analysis = f"{URL}/analyses/{analysed(store, crashed(store), analysis_result())}"
    return {
        "analysis": analysis,
        "mode": f"{analysis}/modes/2",
        "campaign": f"{URL}/campaigns/{campaign}",
    }


@pytest.mark.parametrize("change", CHANGES, ids=lambda each: f"{each[0]} {each[1]}")
def test_outdated_change_is_refused_and_changes_nothing(http, problem, places, change):
    method, path, body, seen = change
    path, seen = path.format(**places), seen.format(**places)
    before = http.get(seen)
    for wanted in ('"nonsense"', "nonsense", f"W/{before.headers['etag']}", '"a", "b"'):
        response = http.request(method, path, json=body, headers={"If-Match": wanted})
        assert problem(response, 412)["type"] == "urn:eigenfail:precondition-failed"
        assert http.get(seen).headers["etag"] == before.headers["etag"]


@pytest.mark.parametrize("change", CHANGES, ids=lambda each: f"{each[0]} {each[1]}")
@pytest.mark.parametrize("wanted", ["{etag}", '"other", {etag}', "*"])
def test_change_of_what_was_seen_is_made(http, places, change, wanted):
    method, path, body, seen = change
    etag = http.get(seen.format(**places)).headers["etag"]
    headers = {"If-Match": wanted.format(etag=etag)}
    response = http.request(method, path.format(**places), json=body, headers=headers)
    assert response.is_success, response.text


def test_change_after_another_one_is_refused(http, problem, places):
    address = f"{places['mode']}/triage"
    seen = {"If-Match": http.get(address).headers["etag"]}
    assert http.post(address, json={"note": "of anna"}, headers=seen).is_success
    problem(http.post(address, json={"note": "of ben"}, headers=seen), 412)
    assert http.get(address).json()["note"] == "of anna"


def test_missing_thing_stays_a_404_whatever_the_precondition(http, problem):
    problem(http.delete(f"{URL}/keys/99", headers={"If-Match": '"a"'}), 404)


def test_of_conditional_changes_at_once_one_is_made(store):
    analysis = analysed(store, crashed(store), analysis_result())
    seen = store.analyses.get_triage(analysis, 1)

    def refuse_newer(found):
        if found != seen:
            raise PreconditionFailed("It was changed.")

    def change(number):
        from eigenfail.values.triage import TriageChange

        try:
            change = TriageChange(note=f"of user {number}")
            store.analyses.change_triage(analysis, 1, change, "key", refuse_newer)
        except PreconditionFailed:
            return 0
        return 1

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(change, range(16))) == 1


def test_transaction_checks_the_precondition_again(http, store, places, monkeypatch):
    """Another change between the look at the tag and the transaction is noticed, too."""
    from eigenfail_api.access import middleware

    async def agree(*_):
        return True

    monkeypatch.setattr(middleware, "holds", agree)
    address = f"{places['mode']}/triage"
    response = http.post(address, json={"note": "seen"}, headers={"If-Match": '"old"'})
    assert response.status_code == 412
    assert http.get(address).json()["note"] == ""
