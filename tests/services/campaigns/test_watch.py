"""The bill of a campaign's time, where the store keeps it and nobody hears so."""

from collections.abc import Iterator
from enum import Enum
from itertools import product
from types import SimpleNamespace

import pytest
from store_checks.examples import running
from store_checks.jobs import claimed

from eigenfail.errors import StoreUnavailable
from eigenfail_services.campaigns import supervisor
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.campaigns.supervisor import SupervisedCampaign
from eigenfail_services.hub.metrics import CampaignPhase, TimeAccounting
from eigenfail_services.store.store import Store, open_store

HOUR_S = 3_600.0
PRICE_USD = 6.0


class Fate(Enum):
    """What becomes of a bill that gets no answer."""

    KEPT = "kept"
    LOST = "lost"


FATES = [
    (Fate.KEPT,),
    (Fate.LOST,),
    (Fate.KEPT, Fate.KEPT),
    (Fate.LOST, Fate.KEPT),
    (Fate.KEPT, Fate.LOST, Fate.KEPT),
]


@pytest.fixture(params=["memory", "sqlite"])
def store(request, tmp_path) -> Iterator[Store]:
    made = (
        open_store("memory://")
        if request.param == "memory"
        else open_store(f"sqlite:///{tmp_path}/a.db")
    )
    yield made
    made.close()


@pytest.fixture
def now_s(monkeypatch) -> list[float]:
    now_s = [1_000.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr(supervisor, "time", clock)
    monkeypatch.setattr(supervisor, "TimeAccounting", lambda: TimeAccounting(clock.monotonic))
    return now_s


@pytest.fixture
def billed(store: Store, now_s: list[float]) -> SupervisedCampaign:
    """A campaign whose learner is at work, and that ran for an hour before."""
    campaign = running(store, price_usd_per_hour=PRICE_USD)
    store.campaigns.add_active(campaign.id, HOUR_S)
    made = SupervisedCampaign(claimed(store), kept_s=HOUR_S)
    made.accounting.set_phase(CampaignPhase.LEARNING)
    return made


@pytest.mark.fault("database connection cut between commit and reply")
@pytest.mark.parametrize("fates", FATES)
def test_time_is_billed_once_whatever_became_of_the_bills(
    store: Store,
    billed: SupervisedCampaign,
    now_s: list[float],
    monkeypatch,
    fates: tuple[Fate, ...],
) -> None:
    add = store.campaigns.add_active

    def unanswered(*bill) -> None:
        if left.pop(0) is Fate.KEPT:
            add(*bill)
        raise StoreUnavailable("The connection was cut.")

    left = [*fates]
    with monkeypatch.context() as patch:
        patch.setattr(store.campaigns, "add_active", unanswered)
        for _ in fates:
            now_s[0] += 100.0
            with pytest.raises(StoreUnavailable):
                billed.bill(store)
            campaign = store.campaigns.get(billed.job.subject)
            assert billed.so_far(campaign).active_s == HOUR_S + now_s[0] - 1_000.0
    now_s[0] += 10.0
    billed.bill(store)
    ran_s = 100.0 * len(fates) + 10.0
    kept = store.campaigns.get(billed.job.subject)
    assert kept.active_s == HOUR_S + ran_s
    assert kept.overhead.learning_s == ran_s
    assert find_cost(kept).total_usd == pytest.approx(PRICE_USD * (1.0 + ran_s / HOUR_S))


@pytest.mark.fault("database connection cut between commit and reply")
@pytest.mark.parametrize("case", [*product(Fate, (0.0, 40.0))], ids=str)
def test_who_claims_again_goes_on_from_what_the_store_has(
    store: Store,
    billed: SupervisedCampaign,
    now_s: list[float],
    monkeypatch,
    case: tuple[Fate, float],
) -> None:
    """Who had it in between may have billed it; of that, nobody can tell what was ours."""
    (fate, others_s), add, campaign = case, store.campaigns.add_active, billed.job.subject

    def unanswered(*bill) -> None:
        if fate is Fate.KEPT:
            add(*bill)
        raise StoreUnavailable("The connection was cut.")

    now_s[0] += 100.0
    with monkeypatch.context() as patch:
        patch.setattr(store.campaigns, "add_active", unanswered)
        with pytest.raises(StoreUnavailable):
            billed.bill(store)
    add(campaign, others_s)
    kept = store.campaigns.get(campaign)
    billed.claim_again(billed.job, kept)
    unbilled_s = 0.0 if case == (Fate.KEPT, 0.0) else 100.0
    assert billed.so_far(kept).active_s == kept.active_s + unbilled_s
    now_s[0] += 10.0
    billed.bill(store)
    after = store.campaigns.get(campaign)
    assert after.active_s == kept.active_s + unbilled_s + 10.0
