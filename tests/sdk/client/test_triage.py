"""Triage by the client: what is changed is found again, and what is left out stays."""

import httpx2
import pytest
from store_checks.modes import analysed, crashed

from eigenfail.errors import InvalidValue, NotFound, UnknownName
from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import UNTOUCHED, TriageCount, TriageState


@pytest.fixture
def made(store):
    campaign = crashed(store)
    return campaign.id, analysed(store, campaign, analysis_result())


def test_a_mode_is_triaged(client, made):
    _, analysis = made
    triage = client.triage
    assert triage.get_mode(analysis, 1) == UNTOUCHED
    first = triage.change_mode(analysis, 1, state="confirmed", owner="anna", labels=["late"])
    then = triage.change_mode(analysis, 1, add_labels=["v2"], ticket="https://tickets/7")
    assert (then.state, then.owner, then.labels) == (first.state, "anna", ("late", "v2"))
    assert triage.get_mode(analysis, 1) == then
    (listed,) = client.analyses.modes(analysis, state=TriageState.CONFIRMED, label="v2")
    assert (listed.number, listed.owner) == (1, "anna")
    assert [mode.number for mode in client.analyses.modes(analysis, owner="")] == [2]
    count = triage.change_modes(analysis, [1, 2], state="confirmed")
    assert count == TriageCount(matched=2, changed=1)


def test_episodes_are_triaged_by_a_filter(client, made):
    campaign, _ = made
    triage = client.triage
    assert triage.change_episodes(campaign, "severity > 11", owner="anna") == TriageCount(2, 2)
    assert triage.change_episode(campaign, 3, owner="").owner == ""
    rows = client.episodes.list(campaign, filter="owner = anna")
    assert [row.index for row in rows] == [2]
    picked = client.episodes.list(campaign, fields=["index", "owner"])
    assert [row["owner"] for row in picked] == ["", "", "anna", ""]


def test_tables_have_the_columns_of_filters(client, made):
    campaign, _ = made
    client.triage.change_episode(campaign, 1, labels=["late", "braking"])
    table = client.episodes.list(campaign).to_pandas()
    assert list(table["label"]) == ["", "braking, late", "", ""]
    assert set(table["state"]) == {"new"}


def test_notes_only_grow(client, made):
    campaign, analysis = made
    texts = [f"note {number}" for number in range(3)]
    for text in texts:
        client.triage.add_mode_note(analysis, 2, text)
    client.triage.add_episode_note(campaign, 0, "of an episode")
    found = client.triage.list_mode_notes(analysis, 2)
    assert [note.text for note in found] == texts[::-1]
    assert [note.text for note in client.triage.list_episode_notes(campaign, 0)] == [
        "of an episode"
    ]


def test_objects_stand_for_their_ids(client, made):
    campaign, analysis = client.campaigns.get(made[0]), client.analyses.get(made[1])
    triage, modes = client.triage, client.analyses.modes(analysis)
    row = client.episodes.list(campaign).first(1)[0]
    assert triage.change_modes(analysis, modes, owner="anna") == TriageCount(2, 2)
    assert triage.change_modes(analysis, modes[0], owner="bob") == TriageCount(1, 1)
    assert triage.get_mode(modes[0], modes[0]) == triage.get_mode(analysis.id, 1)
    assert triage.change_episodes(campaign, "", owner="anna").matched == 4
    assert triage.change_episode(row, state="known") == triage.get_episode(campaign, row.index)
    note = triage.add_episode_note(campaign, row, "late")
    assert list(triage.list_episode_notes(client.episodes.get(row))) == [note]


@pytest.mark.parametrize("given", ["1", "1/../2", 1.0, None, {}])
def test_what_names_nothing_reaches_no_address(scripted, given):
    client, asked = scripted(lambda _request, _number: httpx2.Response(200, json={}))
    triage = client.triage
    calls = [
        lambda: triage.get_mode(given, 1),
        lambda: triage.get_mode(1, given),
        lambda: triage.change_mode(1, given, owner="anna"),
        lambda: triage.change_modes(given, [1], owner="anna"),
        lambda: triage.change_modes(1, [given], owner="anna"),
        lambda: triage.get_episode(given, 1),
        lambda: triage.change_episode(given, 1, owner="anna"),
        lambda: triage.change_episodes(given, "", owner="anna"),
        lambda: triage.list_mode_notes(1, given),
        lambda: triage.list_episode_notes(given, 1),
        lambda: triage.add_mode_note(given, 1, "late"),
        lambda: triage.add_episode_note(1, given, "late"),
    ]
    for call in calls:
        with pytest.raises(InvalidValue):
            call()
    assert not asked


def test_what_cannot_be_is_refused(client, made):
    campaign, analysis = made
    triage = client.triage
    with pytest.raises(InvalidValue, match="ticket"):
        triage.change_mode(analysis, 1, ticket="javascript:alert(1)")
    with pytest.raises(InvalidValue, match="state"):
        triage.change_episode(campaign, 1, state="maybe")
    with pytest.raises(UnknownName, match="staet"):
        triage.change_modes(analysis, [1], staet="known")
    with pytest.raises(UnknownName, match="sevrity"):
        triage.change_episodes(campaign, "sevrity > 1", state="known")
    with pytest.raises(NotFound):
        triage.add_mode_note(analysis, 3, "none")
    assert triage.get_mode(analysis, 1) == triage.get_episode(campaign, 1) == UNTOUCHED
