"""Workers, and what runs below them, killed and held up in the middle of their work."""

import deadlines
import pytest
from stage import Stage
from started import wait_until

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]


@pytest.mark.fault("SIGKILL of a worker's inner process")
def test_killed_inner_processes_cost_no_episode(stage: Stage, undisturbed: dict[str, str]) -> None:
    stage.services()
    workers = [stage.worker(), stage.worker()]
    campaigns = stage.launch()
    for worker in workers * 3:
        # What ran at the last kill is among these: no episode is met three times.
        stage.wait_for_more_from(worker, 20)
        worker.kill_child()
    assert not stage.are_over(campaigns)
    found = stage.unchanged(campaigns, undisturbed)
    assert [worker.said().count("child replaced") for worker in workers] == [3, 3]
    assert found.repeated == 0


@pytest.mark.fault("SIGKILL of a worker")
@pytest.mark.fault(
    "SIGSTOP of a worker",
    group="time",
    outcome="The hub leases its episodes to others after 10 s, and welcomes it again after "
    "SIGCONT. The pause does not count against its episode.",
)
def test_a_killed_and_a_paused_worker_cost_no_episode(
    stage: Stage, undisturbed: dict[str, str]
) -> None:
    services = stage.services()
    killed, paused = stage.worker(), stage.worker()
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for_more_from(killed, 20)
    killed.kill()
    stage.wait_for_more_from(paused, 20)
    paused.halt()
    assert not stage.are_over(campaigns)
    stage.worker()
    wait_until(lambda: services.said().count("worker lost") >= 2, "both are given up")
    paused.go_on()
    stage.unchanged(campaigns, undisturbed)
    wait_until(lambda: services.said().count("worker joined") >= 4, "who was paused is back")
    assert paused.end() == 0
