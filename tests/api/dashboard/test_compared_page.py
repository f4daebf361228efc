"""Two to twelve campaigns on one page."""

import json
import re
from html import unescape

import pytest

from eigenfail.values.episode import Outcome

URL = "/api/v1/campaigns"


@pytest.fixture
def make(http, fields, deliver, result):
    """A campaign with ten episodes, of which some crash."""

    def create(crashes=(), **more):
        made = http.post(URL, json={**fields, **more}).json()["id"]
        outcomes = (Outcome.COLLISION if i in crashes else Outcome.SAFE for i in range(10))
        deliver(made, *(result(i, outcome) for i, outcome in enumerate(outcomes)))
        return made

    return create


def address(ids, **more):
    query = [f"campaign={each}" for each in ids] + [f"{k}={v}" for k, v in more.items()]
    return f"/comparison?{'&'.join(query)}"


def charts(response):
    values = re.findall(r'id="(overlay-\w+)" data-chart="overlay".*?data-values="(.*?)"', response)
    return {name: json.loads(unescape(data)) for name, data in values}


def test_it_begins_with_a_list_to_pick_from(check_page, make):
    one, _ = make(name="apples"), make(name="pears")
    check_page("dashboard/comparison/picker", "/comparison")
    check_page("dashboard/comparison/picker_searched", "/comparison?q=APP")
    check_page("dashboard/comparison/picker_no_match", "/comparison?q=plums")
    check_page("dashboard/comparison/picker_one", address([one], q="pear"))


def test_without_a_campaign_it_leads_to_the_form(check_page):
    check_page("dashboard/comparison/no_campaigns", "/comparison")


def test_all_are_drawn_on_one_pair_of_axes_each(http, make):
    ids = [make((1, 2), name="a"), make((3,), name="b", seed=1), make(name="c", planner="rulebook")]
    found = charts(http.get(address(ids)).text)
    assert list(found) == ["overlay-rate", "overlay-severity", "overlay-robustness"]
    lines = found["overlay-rate"]["lines"]
    assert [int(line["name"].partition(":")[0]) for line in lines] == ids
    rate, _, none = (line["y"] for line in found["overlay-rate"]["lines"])
    assert sum(rate) > 0.0
    assert sum(none) == 0.0
    assert [len(line["x"]) for line in found["overlay-severity"]["lines"]] == [2, 1, 0]
    share = found["overlay-robustness"]["lines"][0]
    assert share["y"][0] == 0.0
    assert share["y"][-1] == 100.0
    assert share["x"] == sorted(share["x"])


def test_costs_are_drawn_once_something_was_spent(http, make, store):
    ids = [make((1,)), make((2,), planner="rulebook")]
    store.campaigns.add_active(ids[0], 3600.0)
    found = charts(http.get(address(ids)).text)["overlay-cost"]
    assert found["look"] == "steps"
    assert found["lines"][0]["y"][-1] == 1.0


def test_everything_is_tested_against_the_first(look, check_page, make):
    first = make((1, 2))
    other = make((1, 2, 3, 4, 5, 6, 7, 8, 9), planner="rulebook")
    check_page("dashboard/comparison/against_the_first", address([first, other]))
    # 7 of 7 pairs that differ, two-sided: 2 ÷ 2⁷.
    differ = "10 pairs: 7 only here, 0 only in the baseline, p = 0.0156"
    assert differ in look(address([first, other]))


def test_the_share_of_a_search_is_compared_with_no_rate(look, make):
    sample, search = make((1, 2)), make((1, 2, 3, 4, 5, 6, 7, 8, 9), method="cem")
    other = make((1,), method="cem", seed=1)
    for ids in ([sample, search], [search, sample], [search, other]):
        text = look(address(ids))
        assert "– not comparable: the episodes of a search are no random sample" in text
        assert "70.0 %" not in text
        assert "is the share of failures among the episodes that it chose, and no failure" in text
    assert f"The line of a search (campaign {search}, {other})" in text
    assert "Share of episodes that failed over episodes" in text
    assert "Failure rate over episodes" not in text
    samples = look(address([sample, make((1, 2, 3), planner="rulebook")]))
    assert "+10.0 % [" in samples
    assert "not comparable" not in samples
    assert "The line of a search" not in samples
    assert "Failure rate over episodes" in samples


def test_versions_of_the_planner_are_a_difference(look, make):
    old, new = make((1, 2), planner_version="1.0"), make((1,), planner_version="1.1")
    text = look(f"/comparison?a={old}&b={new}")
    assert "planner_version 1.0 1.1" in text
    assert "asked for the same thing" not in text
    assert "planner_version 1.0 1.1" in look(address([old, new]))


def test_seeds_are_one_group(check_page, make):
    seeds = [make((1,), seed=seed) for seed in range(2)]
    others = [make((1, 2, 3), seed=seed, planner="rulebook") for seed in range(2)]
    check_page("dashboard/comparison/groups_of_seeds", address([*seeds, *others]))


def test_campaigns_of_one_kind_are_compared_one_by_one(look, make):
    ids = [make((1,), seed=seed) for seed in range(3)]
    text = look(address(ids))
    assert f"Baseline: {ids[0]}: first. " in text
    assert text.count("not paired: their seeds differ") == 2


def test_only_what_differs_is_listed_unless_all_is_asked_for(check_page, make):
    ids = [make(settings={"round_size": 7}), make(planner="rulebook", settings={"round_size": 7})]
    check_page("dashboard/comparison/differing_settings", address(ids))
    check_page("dashboard/comparison/all_settings", address(ids, diff="false"), "settings")


def test_the_switch_keeps_what_was_picked(http, make):
    ids = [make(), make(planner="rulebook")]
    page = http.get(address(ids, q="fi")).text
    href = unescape(re.search(r'href="(/comparison\?[^"]*)#settings"', page)[1])
    assert href == f"/comparison?campaign={ids[0]}&campaign={ids[1]}&q=fi&diff=false"
    assert http.get(href).status_code == 200


def test_campaigns_without_an_episode_can_be_compared_too(check_page, http, fields):
    ids = [http.post(URL, json={**fields, "seed": seed}).json()["id"] for seed in range(2)]
    check_page("dashboard/comparison/without_episodes", address(ids))


def test_the_same_twice_is_once(look, make):
    one = make()
    assert "1 selected" in look(address([one, one]))


@pytest.mark.parametrize(
    ("name", "ids", "status"),
    [
        ("too_many", range(1, 14), 422),
        ("unknown", [1, 99], 404),
        ("not_an_id", ["x"], 422),
    ],
)
def test_what_cannot_be_compared_is_refused_in_words(check_page, make, name, ids, status):
    make()
    check_page(f"dashboard/comparison/refused_{name}", address(ids), status=status)


def test_markup_in_names_is_text(http, make):
    ids = [make(name="<script>1</script>"), make(planner="rulebook")]
    assert "<script>1" not in http.get(address(ids, q="<script>1")).text


def test_each_that_is_chosen_can_be_made_the_first_or_left_out(check_page, make):
    ids = [make(name="a"), make(name="b", seed=1), make(name="c", planner="rulebook")]
    check_page("dashboard/comparison/chosen", address(ids, q="b"), "chosen")


def test_who_picks_more_keeps_the_order_of_what_is_picked(http, make):
    older, newer = make(name="a"), make(name="b")
    page = http.get(address([older, newer])).text
    assert page.index(f'value="{older}" checked') < page.index(f'value="{newer}" checked')
