"""Triage by the client: what is changed is found again, and what is left out stays."""

import httpx2
import pytest
from store_checks.modes import analysed, crashed

from eigenfail.errors import InvalidValue
from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import Triage, TriageState


@pytest.fixture
def analysis(store):
    return analysed(store, crashed(store), analysis_result())


def test_a_mode_is_triaged(client, analysis):
    triage = client.triage
    assert triage.get_mode(analysis, 1) == Triage()
    first = triage.change_mode(analysis, 1, state="confirmed", note="late")
    then = triage.change_mode(analysis, 1, ticket="https://tickets/7")
    assert (then.state, then.note, then.ticket) == (first.state, "late", "https://tickets/7")
    assert triage.get_mode(analysis, 1) == then
    (listed,) = client.analyses.modes(analysis, state=TriageState.CONFIRMED)
    assert (listed.number, listed.state) == (1, "confirmed")
    assert [mode.number for mode in client.analyses.modes(analysis, state="new")] == [2]


def test_objects_stand_for_their_ids(client, analysis):
    found = client.analyses.get(analysis)
    triage, modes = client.triage, client.analyses.modes(found)
    assert triage.change_mode(modes[0], state="known") == triage.get_mode(analysis, 1)
    assert triage.get_mode(modes[0], modes[0]) == triage.get_mode(found, 1)
    assert triage.get_mode(found, modes[1]) == Triage()


@pytest.mark.parametrize("given", ["1", "1/../2", 1.0, None, {}])
def test_what_names_nothing_reaches_no_address(scripted, given):
    client, asked = scripted(lambda _request, _number: httpx2.Response(200, json={}))
    triage = client.triage
    calls = [
        lambda: triage.get_mode(given, 1),
        lambda: triage.get_mode(1, given),
        lambda: triage.change_mode(1, given, note="late"),
        lambda: triage.change_mode(given, 1, note="late"),
    ]
    for call in calls:
        with pytest.raises(InvalidValue):
            call()
    assert not asked
