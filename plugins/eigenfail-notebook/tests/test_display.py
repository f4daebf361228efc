"""What notebooks show: the words of the command line as HTML, escaped and small."""

import re

import pytest
from html_tags import ALLOWED, NASTY, tags
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, make_errored_result
from eigenfail.values.analysis import Mode
from eigenfail.values.estimates import Cost, Interval
from eigenfail.values.rows import SHOWN, Rows
from eigenfail.values.seeds import FirstFailures, SeedFigure, SeedSpread, SeedValue
from eigenfail_notebook import to_pandas
from eigenfail_notebook.display import to_html


@pytest.fixture
def campaign(client, fields):
    return client.campaigns.create(**fields | {"name": NASTY})


def test_every_page_is_small_well_formed_and_escaped(client, campaign, fields):
    other = client.campaigns.create(**fields)
    client.campaigns.create(**fields | {"name": f"suite: {NASTY}"})
    analysis = client.analyses.create(campaign.id)
    pages = {
        "campaign": campaign,
        "summary": client.campaigns.summary(campaign.id),
        "course": client.campaigns.course(campaign.id),
        "safety": client.campaigns.safety(campaign.id),
        "cost": client.campaigns.cost(campaign.id),
        "comparison": client.campaigns.compare(campaign.id, other.id),
        "analysis": analysis,
        "campaigns": client.campaigns.list(),
        "summaries": client.campaigns.summaries(),
        "episodes": client.episodes.list(campaign.id),
        "suites": client.suites.list(),
        "suite": client.suites.table("suite"),
        "analyses": client.analyses.list(campaign.id),
    }
    for name, value in pages.items():
        text = value._repr_html_()
        assert tags(text) <= ALLOWED, name
        assert tags(text), name
        assert "<script" not in text
        assert len(text) < 20_000
    assert "&lt;script&gt;alert(&#x27;[b]x[/b]&#x27;)" in pages["campaigns"]._repr_html_()
    assert "queued" in pages["analysis"]._repr_html_()
    assert "<td>1 queued</td>" in pages["suites"]._repr_html_()
    assert "<th>member</th>" in pages["suite"]._repr_html_()
    assert "&lt;script&gt;" in pages["suite"]._repr_html_()
    assert pages["episodes"]._repr_html_() == "<p>Nothing.</p>"


def test_episodes_and_modes_are_shown_by_themselves(client, store):
    made = running(store, name=NASTY)
    deliver(store, made, collision(0), make_errored_result(1, NASTY))
    rows = client.episodes.list(made)
    mode = Mode(5, 2, 30, NASTY)
    texts = [each._repr_html_() for each in (*rows, *map(client.episodes.get, rows), mode)]
    for text in texts:
        assert tags(text) <= ALLOWED
        assert tags(text)
        assert "<script" not in text
        assert len(text) < 8_000
    assert f"<td>{made.id}/0</td><td>collision</td>" in texts[0]
    assert "<th>outcome</th><td>collision</td>" in texts[2]
    assert "&lt;script&gt;" in texts[3]
    assert "<th>mode</th>" in texts[4]
    assert "&lt;script&gt;" in texts[4]


def test_campaigns_over_seeds_are_shown_as_their_table():
    cost = Cost(2.0, 1.0, 0.5, None, 0.25)
    share = SeedFigure(
        n=2, mean=0.2, deviation=0.1, least=0.1, median=0.2, most=0.3, interval=Interval(0.0, 0.9)
    )
    spread = SeedSpread(
        name="ast",
        method="ast",
        campaigns=(1, 2),
        seeds=(0, 1),
        completed=20,
        failures=4,
        share=share,
        worst=SeedValue(1, 2, 0.1),
        log_probability_per_step=None,
        mean_severity=None,
        first=FirstFailures(median=4.5, worst=7, worst_seed=1, without=0, within=10),
        cost=cost,
    )
    text = spread._repr_html_()
    assert tags(text) <= ALLOWED
    assert "<td>20.0 % [0, 90.0]</td>" in text
    assert "<td>0.500 [0.250, ∞)</td>" in text
    assert to_pandas(spread)["share_mean"].tolist() == [0.2]


def test_a_long_list_shows_its_beginning_and_says_so():
    text = to_html(Rows(lambda: iter(range(1000))))
    assert len(re.findall("<tr><td>", text)) == SHOWN
    assert f"The first {SHOWN}; there are more." in text


def test_showing_a_list_does_not_use_it_up(client, campaign):
    rows = client.campaigns.list()
    assert rows._repr_html_() == rows._repr_html_()
    assert [each.id for each in rows] == [campaign.id]


def test_a_value_of_another_kind_is_shown_as_it_is():
    assert to_html("[/]<b>") == "<p>&#x27;[/]&lt;b&gt;&#x27;</p>"
