"""Planners that change the process they run in, in real workers: no other campaign notices."""

import os
import platform
from collections.abc import Callable

import pytest

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, EpisodeTask, Outcome, PriorSource, episode_seed
from eigenfail.wire.messages import Ack, Hello, Lease, Results, Setup, Welcome
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker.inner_processes import MAX_IDLE, SHARED, InnerProcesses, find_group

EPISODES = 4
SELDOM_S = 60.0

CULPRITS = {
    "rounding": "the floating-point rounding mode, which was to nearest and is upward",
    "denormals": "flush-to-zero of the processor",
    "numpy errors": "numpy's error state (np.seterr)",
    "directory": "the current directory",
    "signals": "the handler of SIGUSR1",
}


def spec(planner: str, **settings) -> CampaignSpec:
    return CampaignSpec(
        name="t",
        method="monte_carlo",
        episodes=EPISODES,
        simulator="point_mass",
        planner=planner,
        planner_settings=settings,
    )


def lease(campaign: int) -> Lease:
    indices = range(EPISODES)
    return Lease(
        campaign, tuple(EpisodeTask(i, episode_seed(0, i), PriorSource()) for i in indices)
    )


@pytest.fixture
def run(hub, start_worker) -> Callable[[int, CampaignSpec], dict[int, EpisodeResult]]:
    """Has one worker run a campaign; its results by index."""
    started = []

    def run(campaign: int, what: CampaignSpec, **variables: str) -> dict[int, EpisodeResult]:
        if not started:
            started.append(start_worker(**variables))
            hub.hear(Hello)
            hub.say(Welcome(heartbeat_s=SELDOM_S))
        hub.say(Setup(campaign, what.setup()), lease(campaign))
        found = [hub.hear(Results).results[0] for _ in range(EPISODES)]
        hub.say(Ack(campaign, tuple(range(EPISODES))))
        return {each.index: each for each in found}

    return run


def digests(results: dict[int, EpisodeResult]) -> list[str]:
    return [results[index].digest() for index in range(EPISODES)]


@pytest.mark.service
@pytest.mark.skipif(platform.machine() != "x86_64", reason="sets bits of x86-64")
@pytest.mark.fault(
    "planner that changes process-wide state",
    group="plug-ins",
    outcome="The episode is errored, and its fault names the planner and what it changed (rounding "
    "mode, flush-to-zero, numpy's error state, directory, signal handlers). The inner process "
    "is replaced; other campaigns keep their digests.",
)
def test_an_episode_that_changes_the_process_is_errored_and_the_next_campaign_is_sound(run) -> None:
    before = digests(run(1, spec("idm")))
    for campaign, (what, named) in enumerate(CULPRITS.items(), start=2):
        results = run(campaign, spec("test_changes_state", what=what))
        for each in results.values():
            assert (each.outcome, each.fault.kind) == (Outcome.ERRORED, "planner"), what
            assert "The planner 'test_changes_state' changed process-wide state" in (
                each.fault.message
            )
            assert named in each.fault.message
    assert digests(run(20, spec("idm"))) == before


@pytest.mark.service
@pytest.mark.fault("planner that changes process-wide state")
def test_an_error_that_follows_from_the_change_is_quoted_and_not_blamed(run) -> None:
    results = run(1, spec("test_changes_state", what="directory", fails=True))
    for each in results.values():
        assert each.fault.kind == "planner"
        assert " and is /. The episode ended with: " in each.fault.message
        assert "ValueError: a consequence" in each.fault.message


@pytest.mark.service
@pytest.mark.fault("planner that changes process-wide state")
def test_episodes_before_the_change_are_kept_and_those_after_it_begin_in_a_fresh_process(
    run,
) -> None:
    """The planner counts its episodes in a global, so that it shows in which process each ran."""
    sound = digests(run(1, spec("test_changes_state", what="nothing")))
    results = run(2, spec("test_changes_state", what="rounding", from_episode=1))
    outcomes = [results[index].outcome is Outcome.ERRORED for index in range(EPISODES)]
    assert outcomes == [False, True, False, True]
    assert [digests(results)[index] for index in (0, 2)] == [sound[0], sound[2]]


PATCHES = """
import msgspec
import numpy as np
from eigenfail.values.scene import Control

np.seterr(all="raise")
array = np.array
np.array = lambda *values: 2 * array(*values)

class Planner:
    class Settings(msgspec.Struct, frozen=True):
        pass
    def __init__(self, settings): ...
    def reset(self, mission): ...
    def act(self, perception):
        return Control(0.0, 0.0)
"""

FAILS = """
class Unreadable(Exception):
    def __str__(self):
        raise RuntimeError("no text")

raise Unreadable
"""


@pytest.fixture
def import_path(tmp_path) -> str:
    """A folder with planners that do harm when they are imported."""
    (tmp_path / "patches.py").write_text(PATCHES)
    (tmp_path / "fails.py").write_text(FAILS)
    notes = tmp_path / "harmful-0.0.dist-info"
    notes.mkdir()
    (notes / "METADATA").write_text("Metadata-Version: 2.1\nName: harmful\nVersion: 0.0\n")
    planners = "test_patches = patches:Planner\ntest_fails = fails:Planner\n"
    (notes / "entry_points.txt").write_text(f"[eigenfail.planners]\n{planners}")
    return os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])


@pytest.mark.service
@pytest.mark.fault(
    "plug-in whose import changes the process",
    group="plug-ins",
    outcome="Only episodes of its own campaign run in that process; controller and services "
    "restore their floating-point mode, numpy's error state, directory and signal handlers.",
)
def test_what_an_import_changes_stays_with_its_campaign(run, import_path) -> None:
    before = digests(run(1, spec("idm"), PYTHONPATH=import_path))
    patched = run(2, spec("test_patches"))
    assert patched.keys() == set(range(EPISODES))
    assert digests(run(3, spec("idm"))) == before


@pytest.mark.service
@pytest.mark.fault(
    "plug-in whose import raises",
    group="plug-ins",
    outcome="Its episodes are errored with the reason; the inner process goes on.",
)
def test_a_plug_in_whose_import_raises_costs_no_process(run, import_path) -> None:
    results = run(1, spec("test_fails"), PYTHONPATH=import_path)
    assert {each.fault.kind for each in results.values()} == {"input"}
    message = results[0].fault.message
    assert "'test_fails' cannot be loaded: Unreadable: <the text of this Unreadable" in message


@pytest.mark.service
@pytest.mark.fault(
    "plug-in error whose text cannot be kept",
    group="plug-ins",
    outcome="The episode is errored once, blamed on the plug-in, with the text made safe and "
    "cut off at a bound.",
)
def test_an_error_of_any_text_costs_one_episode_and_is_blamed_on_the_planner(run) -> None:
    expected = {
        "lone surrogate": "raised ValueError: half of a pair: \\udc80.",
        "NUL": "raised ValueError: before\\x00after.",
        "megabytes": "xxx … (cut off)",
        "__str__ raises": "raised UnreadableError: <the text of this UnreadableError cannot",
        "__str__ returns a number": "raised EvasiveError: <the text of this EvasiveError cannot",
    }
    for campaign, (text, said) in enumerate(expected.items(), start=1):
        for each in run(campaign, spec("test_raises_text", text=text)).values():
            assert (each.outcome, each.fault.kind) == (Outcome.ERRORED, "planner"), each.fault
            assert said in each.fault.message
            assert len(each.fault.message) <= 4_000


class PlayedProcess:
    def __init__(self) -> None:
        self.running, self.has_campaigns = [], False
        self.dropped, self.over, self.greed, self.mib = [], False, "", 100.0
        self.finished = self.ended = False

    def memory_mib(self) -> float:
        return self.mib

    def drop(self, campaign: int) -> None:
        self.dropped.append(campaign)

    def finish(self) -> None:
        self.finished = True

    def has_ended(self) -> bool:
        return self.over or self.ended

    def find_excess(self) -> str:
        return self.greed

    def end(self) -> int:
        self.ended = True
        return 0


@pytest.fixture
def processes() -> InnerProcesses:
    made = InnerProcesses(PlayedProcess, Limits())
    made._next_check_s = 0.0
    return made


def use(processes: InnerProcesses, group: int) -> PlayedProcess:
    assert processes.select(group)
    processes.active.has_campaigns = True
    return processes.active


def tend(processes: InnerProcesses) -> None:
    processes._next_check_s = 0.0
    processes.clean_up()


def test_a_campaign_keeps_its_process_while_others_run_in_theirs(processes) -> None:
    first, second = use(processes, 0), use(processes, SHARED)
    assert first is not second
    assert use(processes, 0) is first
    assert use(processes, SHARED) is second


def test_a_process_without_a_campaign_takes_on_the_first(processes) -> None:
    blank = processes.active
    assert use(processes, 7) is blank


def test_a_process_that_holds_episodes_is_not_set_aside(processes) -> None:
    busy = use(processes, 1)
    busy.running.append("an episode")
    assert not processes.select(2)
    busy.running.clear()
    assert use(processes, 2) is not busy


def test_the_process_of_a_campaign_that_was_dropped_closes_and_is_never_used_again(
    processes,
) -> None:
    idle, active = use(processes, 1), use(processes, 2)
    processes.drop(1)
    processes.drop(2)
    assert idle.finished
    assert (idle.dropped, active.dropped) == ([1], [1, 2])
    assert use(processes, 2) is not active
    assert active.finished
    idle.over = active.over = True
    tend(processes)
    assert idle.ended
    assert active.ended


def test_a_process_that_does_not_close_is_killed(processes, monkeypatch) -> None:
    idle = use(processes, 1)
    use(processes, 2)
    monkeypatch.setattr("eigenfail_workers.worker.inner_processes.CLOSING_S", -1.0)
    processes.drop(1)
    tend(processes)
    assert idle.ended


def test_few_idle_processes_are_kept_and_none_that_takes_much(processes) -> None:
    made = [use(processes, campaign) for campaign in range(MAX_IDLE + 2)]
    assert [each.finished for each in made] == [True] + [False] * (MAX_IDLE + 1)
    processes.active.mib = Limits().memory_mib / 2
    large = processes.active
    use(processes, 99)
    assert large.finished


def test_an_idle_process_that_dies_or_takes_too_much_is_ended(processes) -> None:
    dead, greedy, idle, _ = (use(processes, campaign) for campaign in range(4))
    dead.over, greedy.greed = True, "ran 5000 threads"
    tend(processes)
    assert (dead.ended, greedy.ended, idle.ended) == (True, True, False)
    assert use(processes, 2) is idle
    assert use(processes, 0) is not dead


def test_an_idle_process_whose_memory_grows_is_ended(processes) -> None:
    growing, _ = use(processes, 1), use(processes, 2)
    growing.mib = Limits().memory_mib / 2
    tend(processes)
    assert growing.ended


def test_a_process_that_takes_too_much_while_it_closes_is_killed(processes) -> None:
    closing, _ = use(processes, 1), use(processes, 2)
    processes.drop(1)
    closing.greed = "ran 5000 threads"
    tend(processes)
    assert closing.ended


def test_the_end_ends_all(processes) -> None:
    made = [use(processes, campaign) for campaign in range(3)]
    processes.drop(0)
    processes.end()
    assert all(each.ended for each in made)


@pytest.mark.parametrize(
    ("changes", "group"),
    [
        ({"planner": "idm"}, SHARED),
        ({"simulator": "bridge", "planner": "whatever the bridge knows"}, SHARED),
        ({"planner": "test_raises"}, 5),
        ({"planner": "unknown"}, 5),
        ({"simulator": "unknown"}, 5),
        ({"scenario": "unknown"}, 5),
        ({"simulator": "function", "scenario": "function", "planner": "module:function"}, 5),
    ],
)
def test_only_campaigns_of_built_in_parts_share_a_process(changes, group) -> None:
    fields = {"planner": "rulebook", **changes}
    setup = CampaignSpec(name="t", method="monte_carlo", episodes=1, **fields).setup()
    assert find_group(5, setup) == group
