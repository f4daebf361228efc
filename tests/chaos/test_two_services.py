"""Two services on one database: one stands still, the other takes over, the first comes back."""

import deadlines
import pytest
from stage import Stage
from started import free_port, wait_until

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]


@pytest.mark.fault(
    "SIGSTOP of the services",
    group="time",
    outcome="After 10 s another service on the same database takes over their campaigns. "
    "PostgreSQL ends a transaction in which they stand still after 10 s, and from "
    "version 17 on a statement that hands over rows after 30 s; SQLite takes no "
    "writes until they continue or are killed. The time that they lost counts against"
    " no worker.",
)
@pytest.mark.fault("two services on one database")
def test_a_service_that_stood_still_is_taken_over_from(
    stage: Stage, undisturbed: dict[str, str]
) -> None:
    first, other_hub = stage.services(), f"tcp://127.0.0.1:{free_port()}"
    first_worker, second_worker = stage.worker(), stage.worker(other_hub)
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for_more_from(first_worker, 20)
    second = stage.services(other_hub)
    stage.halt(first)
    assert not stage.are_over(campaigns)
    stage.wait_for_more_from(second_worker, 20)  # the leases of the first one have run out
    first.go_on()
    wait_until(lambda: "lost to another" in first.said(), "the first one notices")
    stage.unchanged(campaigns, undisturbed)
    assert [services.end() for services in (first, second)] == [0, 0]
