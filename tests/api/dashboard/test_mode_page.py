"""The page of a failure mode, and the ways to it and back."""

import re

import pytest
from msgspec.structs import replace
from store_checks.modes import WORDS, analysed, crashed, pooled

from eigenfail.testing.examples import analysis_result


def listed(page):
    """The episodes in the table, in its order."""
    return [int(index) for index in re.findall(r'<th scope="row"><a href="[^"]*/(\d+)"', page)]


@pytest.fixture
def mode(store):
    """A mode of two failures, and their campaign; the address of its page."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, replace(analysis_result(), words=WORDS))
    return campaign, f"/analyses/{analysis}/modes/2"


def test_a_mode_has_a_page(mode, check_page):
    check_page("dashboard/mode/group", mode[1])


def test_its_failures_can_be_sorted(mode, http, look):
    _, address = mode
    assert listed(http.get(address).text) == [3, 1]
    assert listed(http.get(f"{address}?sort=severity").text) == [1, 3]
    assert "mode" in look(f"{address}?sort=mode", 422)


def test_episodes_lead_to_their_mode_and_back(mode, http, store):
    campaign, address = mode
    episode = http.get(f"/campaigns/{campaign.id}/episodes/3").text
    assert f'href="{address}"' in episode
    page = http.get(address).text
    assert f'href="/campaigns/{campaign.id}/episodes/3"' in page
    assert "filter=mode+%3D+2" in page
    analysed(store, campaign, analysis_result())
    older = http.get(address).text
    assert "filter=mode" not in older, "A filter has the modes of the newest analysis."


def test_the_name_of_a_mode_can_be_changed(mode, http, look):
    _, address = mode
    answer = http.put(f"/api/v1{address}/name", json={"name": "late <braking>"})
    assert answer.status_code == 200
    assert answer.json()["name"] == "late <braking>"
    assert "late <braking>" in look(address)


def test_failures_of_several_campaigns_say_where_they_are_from(store, look):
    _, other, analysis = pooled(store)
    assert f"{other.id}/2" in look(f"/analyses/{analysis}/modes/2")


def test_a_filter_is_offered_only_where_it_finds_just_the_mode(store, http):
    one, other = crashed(store), crashed(store, 2)
    older = analysed(store, one, analysis_result())
    analysed(store, one, replace(analysis_result(2), episodes=(2, 3)))
    of_both = replace(analysis_result(), episodes=(0, 1, 0, 1), campaigns=(2, 2, 1, 1))
    both = analysed(store, other, of_both)
    for address in (f"/analyses/{older}/modes/2", f"/analyses/{both}/modes/1"):
        assert "filter=mode" not in http.get(address).text, address


def test_modes_that_are_not_there(mode, look):
    _, address = mode
    assert "has no mode 9" in look(f"{address[:-1]}9", 404)
