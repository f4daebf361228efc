"""A page is told of all its scripts at once, and its later part is begun beside it."""

import re
from concurrent.futures import Future

import pytest
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision
from eigenfail_api.dashboard import campaign_page
from eigenfail_api.dashboard.rendering import STATIC, list_modules
from eigenfail_services.campaigns import costs

HTML = {"Accept": "text/html"}


@pytest.mark.parametrize("address", ["/", "/suites", "/launch", "/comparison", "/glossary"])
def test_all_that_a_page_imports_is_named_in_its_head(http, address) -> None:
    text = http.get(address).text
    named = set(re.findall(r'rel="modulepreload" href="/static/js/([\w.]+)"', text))
    entry = re.search(r'src="/static/js/([\w.]+)" type="module"', text)[1]
    assert named == set(list_modules(entry)) == imported(entry)
    assert ("echarts.min.js" in text) == ("charts.js" in named)


def imported(script: str) -> set[str]:
    """A script and what it imports, one after the other; not what it asks for at a click."""
    text = (STATIC / "js" / script).read_text("utf-8")
    return {script}.union(*(imported(each) for each in re.findall(r'(?<!\()"\./([\w.]+)"', text)))


def test_a_page_that_asks_again_does_not_begin_its_later_part(store, http, monkeypatch) -> None:
    campaign = running(store)
    deliver(store, campaign, collision(0))
    asked = []
    spending = store.figures.spending
    monkeypatch.setattr(store.figures, "spending", lambda *a: asked.append(a) or spending(*a))
    address = f"/campaigns/{campaign.id}"
    assert http.get(address, headers=HTML | {"HX-Request": "true"}).status_code == 200
    assert asked == []
    assert http.get(address).status_code == 200
    assert asked


@pytest.mark.parametrize(("is_done", "state"), [(True, "made"), (False, "wanted")])
def test_a_later_part_that_is_known_already_is_in_the_page(
    store, http, monkeypatch, is_done, state
) -> None:
    campaign = running(store)
    deliver(store, campaign, collision(0))
    monkeypatch.setattr(campaign_page.costs, "is_prefetched", lambda begun: is_done)
    text = http.get(f"/campaigns/{campaign.id}").text
    assert re.findall(r'id="measures" data-later="(\w+)"', text) == [state]
    assert ('id="measures-basis"' in text) == is_done


def test_what_failed_beside_the_page_is_not_known() -> None:
    failed, done, open_ = Future(), Future(), Future()
    failed.set_exception(ValueError())
    done.set_result(None)
    assert costs.is_prefetched([done])
    assert not costs.is_prefetched([done, failed])
    assert not costs.is_prefetched([done, open_])
