"""Every store keeps the contract."""

import pytest
from store_checks import STORE_CHECKS


@pytest.mark.fault("episode that kills its worker")
@pytest.mark.fault(
    "result that arrives twice, late, unasked or for another campaign",
    group="messages",
    outcome="It is stored once and counted as a duplicate, or answered as unwanted.",
)
@pytest.mark.fault("arrays of another shape, or with invalid numbers")
@pytest.mark.fault(
    "worker that reports NaN",
    group="plug-ins",
    outcome="Measures are stored and learned from without it, and the episode counts as "
    "reported. Analyses refuse noise with NaN and name the episode.",
)
@pytest.mark.fault(
    "second result of an episode with another digest",
    group="plug-ins",
    outcome="The first one counts. Event `episode.alarm`, metric "
    '`eigenfail_results_total{verdict="alarm"}`, alert `EpisodesDiffer`.',
)
@pytest.mark.parametrize("check", STORE_CHECKS, ids=lambda check: check.__name__)
def test_store(check, store) -> None:
    check(store)
