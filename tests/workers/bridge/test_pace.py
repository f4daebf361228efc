"""What a step of a bridge may take."""

import pytest

from eigenfail.cli.plugin_checks import CheckVerdict
from eigenfail.values.disturbance import POSITION
from eigenfail_workers.bridge.checks import BridgePace, measure_pace
from eigenfail_workers.bridge.connection import Connection, make_timeouts
from eigenfail_workers.bridge.episode import list_injected
from eigenfail_workers.bridge.messages import SlotStart


@pytest.mark.parametrize(
    ("alone_s", "verdict", "said"),
    [
        (0.004, CheckVerdict.PASSED, "4 ms a step, 25 × real time; 20 ms for 8 side by side."),
        (0.4, CheckVerdict.SLOW, "0.25 × real time"),
        (
            0.6,
            CheckVerdict.BROKEN,
            "An episode takes 60 s, and is given up after 50 s. Make it faster",
        ),
    ],
)
def test_it_is_held_against_the_time_of_its_world_and_that_of_an_episode(alone_s, verdict, said):
    found = BridgePace(0.1, alone_s, 0.02, 8).judge(100, make_timeouts(60.0))
    assert found[0] is verdict
    assert said in found[1]


def test_it_is_measured_alone_and_side_by_side(serving) -> None:
    with serving(slots=3) as address:
        connection = Connection(address)
        channels = list_injected(POSITION)
        start = SlotStart(0, 0, "cut_in", {}, "idm", {}, 100, channels)
        pace = measure_pace(connection, start)
        connection.close()
    assert (pace.dt_s, pace.beside) == (0.1, 3)
    assert pace.alone_s > 0.0
    assert pace.together_s > 0.0


@pytest.mark.parametrize("limit_s", [1.0, 6.0, 60.0, 3600.0])
def test_what_a_worker_waits_for_ends_before_its_own_patience_does(limit_s: float) -> None:
    patience = make_timeouts(limit_s)
    assert 0.0 < patience.answer_s < patience.episode_s < limit_s
    assert limit_s - patience.episode_s <= 10.0
    assert patience.hello_s == pytest.approx(limit_s - patience.episode_s)
