"""SIGTERM and Ctrl-C, once and twice, in the middle of the work."""

import signal

import deadlines
import pytest
from stage import Stage

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]


@pytest.mark.fault("SIGTERM or Ctrl-C of a service, once or twice")
@pytest.mark.fault("SIGTERM or Ctrl-C of a worker, once or twice")
def test_who_is_told_to_stop_hands_over_and_exits_with_0(
    stage: Stage, undisturbed: dict[str, str]
) -> None:
    services, controller = stage.services(), stage.controller()
    terminated, interrupted = stage.worker(), stage.worker()
    campaigns = stage.launch("monte_carlo", "difs")
    for worker, signal_ in ((terminated, signal.SIGTERM), (interrupted, signal.SIGINT)):
        stage.wait_for_more_from(worker, 20)
        worker.process.send_signal(signal_)
        assert worker.end(signal_) == 0
    stage.wait_for_more_from(stage.worker(), 20)
    for process in (services, controller):
        process.process.send_signal(signal.SIGTERM)
        assert process.end(signal.SIGINT) == 0
    assert not stage.are_over(campaigns)
    stage.services()
    stage.worker()
    found = stage.unchanged(campaigns, undisturbed)
    assert found.repeated == 0
