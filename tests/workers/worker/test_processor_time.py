"""Processor time, held against what episodes may take; the clock is played."""

import subprocess
import sys

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail_workers.limits import Limits
from eigenfail_workers.worker.resources import ProcessorTimeMeter, ResourceMonitor, processor_time_s

LIMITS = Limits(cpu_s=40.0, processors=2.0)
SPINS = "\nimport os\nif os.fork() == 0:\n    while True: pass\nos.read(0, 1)"
LOOK_S = 0.2
WAITED_FOR = """
import os, time, psutil
from eigenfail_workers.worker.resources import processor_time_s
before_s = processor_time_s([psutil.Process()])
if os.fork() == 0:
    while time.process_time() < 0.4: pass
    os._exit(0)
os.wait()
print(processor_time_s([psutil.Process()]) - before_s)
"""


class Played:
    """A process that keeps processors busy, and looks at what it takes as a worker does."""

    def __init__(self, limits: Limits = LIMITS) -> None:
        self.now_s = self.taken_s = 0.0
        self.meter = ProcessorTimeMeter(limits, lambda: self.now_s)

    def run(self, episode: object, wall_s: float, processors: float) -> str:
        for _ in range(max(1, round(wall_s / LOOK_S))):
            if excess := self.meter.find_excess(self.taken_s, episode):
                return excess
            self.now_s += LOOK_S
            self.taken_s += processors * LOOK_S
        return self.meter.find_excess(self.taken_s, episode)


@pytest.mark.fault("planner that leaves threads or processes spinning")
def test_an_episode_that_takes_too_much_is_told_with_limit_and_names() -> None:
    assert Played().run(object(), 12.0, 3.0) == ""
    assert Played().run(object(), 15.0, 3.0) == (
        "took 40 s of processor time, where 40 s is the limit "
        "(--cpu-limit of the worker, or EIGENFAIL_CPU_LIMIT_S)"
    )


@given(st.lists(st.tuples(st.floats(0.2, 20.0), st.floats(0.0, 2.0)), max_size=20))
def test_who_keeps_no_more_busy_than_he_may_goes_on_for_ever(episodes) -> None:
    played = Played()
    assert not any(played.run(object(), wall_s, processors) for wall_s, processors in episodes)


@pytest.mark.fault("planner that leaves threads or processes spinning")
def test_what_goes_on_behind_short_episodes_adds_up() -> None:
    played = Played()
    assert any(played.run(object(), 0.2, 3.0) for _ in range(220))


@pytest.mark.fault("planner that leaves threads or processes spinning")
@pytest.mark.parametrize("before", [None, object()])
def test_what_goes_on_while_nothing_runs_adds_up(before) -> None:
    played = Played()
    assert played.run(before, 10.0, 1.0) == ""
    assert played.run(None, 20.0, 1.0) == ""
    assert "of processor time" in played.run(None, 30.0, 1.0)


@pytest.mark.fault("planner that leaves threads or processes spinning")
def test_that_of_descendants_counts() -> None:
    spins = subprocess.Popen([sys.executable, "-c", SPINS], stdin=subprocess.PIPE)
    process = psutil.Process(spins.pid)
    try:
        watch = ResourceMonitor(spins.pid, Limits(cpu_s=0.3))
        while not (told := watch.find_excess()):
            pass
        assert "of processor time, where 0.3 s is the limit" in told
        assert processor_time_s([process]) < processor_time_s([process, *process.children()])
    finally:
        for each in process.children():
            each.kill()
        spins.communicate()
    assert processor_time_s([process]) == 0.0


def test_a_child_that_was_waited_for_counts() -> None:
    told = subprocess.run(
        [sys.executable, "-c", WAITED_FOR], capture_output=True, check=True, text=True
    )
    assert float(told.stdout) > 0.3


def test_many_side_by_side_may_take_as_often_as_much() -> None:
    meter = ProcessorTimeMeter(LIMITS, lambda: 0.0)
    assert meter.find_excess(0.0, (1, 0), beside=3) == ""
    assert meter.find_excess(120.0, (1, 0), beside=3) == ""
    assert "where 120 s is the limit" in meter.find_excess(121.0, (1, 0), beside=3)
