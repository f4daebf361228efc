"""Numbers and texts that no episode has, from a worker that lies or is broken."""

from math import inf, nan

import pytest
from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.testing.examples import result, spec
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery, Verdict
from eigenfail_services.hub.metrics import TimeAccounting

LIES = (1e308, -1e308, -1.0, inf, -inf, nan, 8 * 86_400.0)


@pytest.fixture
def campaign(store) -> int:
    made = store.campaigns.create(accept_spec(spec(episodes=20))).id
    store.campaigns.move(made, "running")
    return made


@pytest.mark.fault(
    "worker that reports impossible numbers",
    group="messages",
    outcome="Results are kept without them: wall times beyond a week, measures that "
    "are negative or too large.",
)
def test_an_impossible_wall_time_is_not_stored(store, campaign):
    told = [Delivery(replace(result(n), wall_s=lie), "w") for n, lie in enumerate(LIES)]
    assert store.episodes.commit(campaign, told) == [Verdict.KEPT] * len(LIES)
    assert {row.wall_s for row in store.episodes.page(campaign, 50).items} == {0.0}
    assert {each.believed_wall_s for each in (delivery.result for delivery in told)} == {0.0}
    assert replace(result(0), wall_s=60.0).believed_wall_s == 60.0


@pytest.mark.fault("worker that reports impossible numbers")
@pytest.mark.parametrize("lie", [1e308, -1e308, 1e16, inf, nan, -1.0])
def test_an_impossible_measure_is_not_stored(store, campaign, lie):
    fields = dict.fromkeys(("severity", "min_ttc_s", "max_drac_mps2", "max_jerk_mps3"), lie)
    told = [
        Delivery(result(0, Outcome.COLLISION, measures=Measures(0.0, **fields)), "w"),
        Delivery(result(1, measures=Measures(lie, severity=1.0)), "w"),
    ]
    assert store.episodes.commit(campaign, told) == [Verdict.KEPT] * 2
    first, second = store.episodes.page(campaign, 50).items
    assert {getattr(first, name) for name in fields} == {None}
    assert (second.robustness_m, second.severity) == (None, None)
    assert store.figures.totals([campaign])[campaign].severity is None


@pytest.mark.fault("worker that reports impossible numbers")
@pytest.mark.parametrize("index", [-1, 20, 2**63, 2**64 - 1, -(2**63)])
def test_a_result_of_an_episode_that_cannot_be_is_refused_alone(store, campaign, index):
    told = [Delivery(replace(result(0), index=each), "w") for each in (0, index)]
    assert store.episodes.commit(campaign, told) == [Verdict.KEPT, Verdict.UNWANTED]


def test_what_was_thrown_away_is_billed_by_what_is_believed():
    meter = TimeAccounting()
    meter.add_discarded(replace(result(0), wall_s=1e308).believed_wall_s)
    assert meter.take().discarded_s == 0.0
