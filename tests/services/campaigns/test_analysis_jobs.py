"""Processes of analyses, and what they make of the failures of one or several campaigns."""

import errno
import resource
import subprocess
import sys
import time

import deadlines
import msgspec
import numpy as np
import psutil
import pytest
from store_checks.examples import analyse_function, deliver, name_channels, running

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, AnalysisState
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Job, JobKind
from eigenfail.values.requirements import TimeHeadway
from eigenfail.values.shapes import Correlated
from eigenfail_services.analysis import clusters
from eigenfail_services.analysis.job import hash_result
from eigenfail_services.bounds import SettingBounds
from eigenfail_services.campaigns import analysis_jobs as module
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs, find_basis, run_analysis
from eigenfail_services.hub.metrics import Timeout
from eigenfail_services.store.store import Store, open_store

QUICK = AnalysisSettings(bootstrap=2)


class Process:
    """Runs for ever."""

    started = 0
    pid = returncode = 0

    def __init__(self, *_args, **_named) -> None:
        Process.started += 1

    def poll(self) -> None:
        return


def test_our_own_lease_that_ran_out_starts_no_second_process(monkeypatch) -> None:
    monkeypatch.setattr(module.subprocess, "Popen", Process)
    renewed = []
    store = open_store("memory://")
    monkeypatch.setattr(store.jobs, "renew", lambda job, _lease_s: renewed.append(job.token))
    analyses = AnalysisJobs(store, "memory://")
    job = Job(1, JobKind.ANALYSIS, 5, "old", 1)
    analyses.open(job)
    analyses.open(msgspec.structs.replace(job, token="new"))
    assert (len(analyses), Process.started) == (1, 1)
    analyses.poll()
    assert renewed == ["new"]


@pytest.fixture(autouse=True)
def few_draws(monkeypatch) -> None:
    """These tests are not of what is more than noise."""
    monkeypatch.setattr(clusters, "NOISE_DRAWS", 2)


def campaign(store: Store, *failures: int, **changes) -> int:
    """A campaign that runs, with failures at these indices and one episode that was safe."""
    made = running(store, episodes=60, **changes)
    crashes = [collision(index, steps=20 + index % 5, salt=made.id) for index in failures]
    deliver(store, made, result(0), *crashes)
    return made.id


def analysed(store: Store, first: int, settings: AnalysisSettings = QUICK) -> AnalysisResult:
    analysis = store.analyses.create(first, settings).id
    run_analysis(store, analysis)
    done = store.analyses.get(analysis)
    assert (done.state, done.problem) == (AnalysisState.DONE, "")
    assert done.result is not None
    return done.result


def problem(store: Store, first: int, settings: AnalysisSettings = QUICK) -> str:
    analysis = store.analyses.create(first, settings).id
    run_analysis(store, analysis)
    refused = store.analyses.get(analysis)
    assert (refused.state, refused.result) == (AnalysisState.FAILED, None)
    return refused.problem


def test_several_campaigns_are_analysed_together(store: Store) -> None:
    one, other = campaign(store, *range(5, 25)), campaign(store, *range(1, 31), seed=2)
    found = analysed(store, one, AnalysisSettings(campaigns=(other, other, one), bootstrap=2))
    assert found.campaigns == (one,) * 20 + (other,) * 30
    assert found.episodes == (*range(5, 25), *range(1, 31))
    assert [(each.campaign, each.failures) for each in found.sources] == [(one, 20), (other, 30)]
    for position, mode in enumerate(found.modes):
        row = list(zip(found.campaigns, found.episodes, strict=True)).index(
            (mode.medoid_campaign, mode.medoid)
        )
        assert found.labels[row] == position
    assert found.diversity.failures == sum(each.failures for each in found.training) == 50


def test_of_a_method_that_learnt_and_gives_weights_all_are_analysed_and_it_says_so(
    store: Store,
) -> None:
    """`cem` estimates a probability for each mode, which needs every failure."""
    one, calm = campaign(store, *range(5, 26), method="cem"), campaign(store, *range(5, 26))
    found = analysed(store, one)
    assert found.episodes == tuple(range(5, 26))
    assert found.notes[-1] == (
        f"Campaign {one} learnt while it ran, and failures of its whole course were analysed: "
        "modes may be stages of its search."
    )
    assert not any("stages" in note for note in analysed(store, calm).notes)


@pytest.mark.parametrize("method", ["ast", "difs", "ensemble"])
def test_of_a_method_that_learnt_the_latest_half_is_analysed_and_it_says_so(
    store: Store, method: str
) -> None:
    one = campaign(store, *range(5, 26), method=method)
    found = analysed(store, one)
    assert found.episodes == tuple(range(15, 26))
    assert sum(mode.failures for mode in found.modes) == found.sources[0].failures == 11
    assert sum(each.failures for each in found.training) == 21
    assert found.notes[-1] == (
        f"Campaign {one} learnt while it ran: the latest 11 of its 21 failures were analysed. "
        "Set failures to all to analyse every one. Its modes are groups of this search: another "
        "seed may find others, and their shares are no probabilities under p(x)."
    )
    whole = analysed(store, one, msgspec.structs.replace(QUICK, failures="all"))
    assert whole.episodes == tuple(range(5, 26))
    assert whole.notes[-1].startswith(f"Campaign {one} learnt while it ran. Its modes are groups")


@pytest.mark.parametrize("method", ["held", "subset"])
def test_of_other_methods_all_failures_are_analysed(store: Store, method: str) -> None:
    one = campaign(store, *range(5, 26), method=method)
    found = analysed(store, one)
    assert found.episodes == tuple(range(5, 26))
    assert not any("learnt" in note for note in found.notes)


def test_which_campaign_is_named_first_does_not_matter(store: Store) -> None:
    one, other = campaign(store, *range(1, 20)), campaign(store, *range(1, 20))
    there = analysed(store, one, AnalysisSettings(campaigns=(other,), bootstrap=2))
    back = analysed(store, other, AnalysisSettings(campaigns=(one,), bootstrap=2))
    told = {"sources": ()}
    digests = {hash_result(msgspec.structs.replace(each, **told)) for each in (there, back)}
    assert len(digests) == 1


def test_a_campaign_that_still_runs_is_a_snapshot_and_it_says_so(store: Store) -> None:
    one = campaign(store, *range(1, 12))
    deliver(store, store.campaigns.get(one), make_errored_result(40))
    found = analysed(store, one)
    (source,) = found.sources
    assert (source.episodes, source.failures, source.running) == (13, 11, True)
    assert found.notes == (f"A snapshot: more episodes were to come in campaign {one}.",)
    store.campaigns.move(one, "cancelling")
    store.campaigns.move(one, "cancelled")
    over = analysed(store, one)
    assert (over.notes, over.sources[0].running) == ((), False)


def test_what_lands_while_failures_are_read_is_counted(store: Store, monkeypatch) -> None:
    one = campaign(store, *range(1, 12))
    read = store.episodes.failure_portions

    def land(number: int):
        deliver(store, store.campaigns.get(one), *map(collision, range(20, 30)))
        return read(number)

    monkeypatch.setattr(store.episodes, "failure_portions", land)
    (source,) = analysed(store, one).sources
    assert (source.episodes, source.failures) == (22, 21)


def test_a_result_has_its_digest_and_it_is_the_same_again(store: Store) -> None:
    one = campaign(store, *range(1, 12))
    first, second = analysed(store, one), analysed(store, one)
    assert first.digest == second.digest == hash_result(first)


def test_seconds_come_from_the_scenario(store: Store) -> None:
    found = analysed(store, campaign(store, *range(1, 12)))
    # Failures of 20 to 24 steps of 0.1 s; their median is 22.
    for each in found.moments:
        assert each.before_collision_s == pytest.approx((22 - each.step) * 0.1)
    assert [each.seconds for each in found.before_collision] == [1.0, 2.0]


def test_behaviour_comes_from_the_scenes_of_the_failures(store: Store) -> None:
    one = campaign(store, *range(1, 12))
    found = analysed(store, one)
    assert (found.features, found.notes[1:]) == ("behaviour", ())
    assert (found.behaviour.origin, len(found.behaviour.times_s)) == ("collision", 45)
    speeds = {index: collision(index, steps=20 + index % 5).scene.vehicles for index in (5, 11)}
    for row, vehicles in speeds.items():
        # Of failures as different as these each is likely to be near no other.
        own = np.diff(vehicles[:, 0, 3].astype(np.float64)) / 0.1
        members = np.concatenate([mode.members for mode in found.behaviour.modes])
        away = np.abs(members[:, -len(own) :] - own).max(axis=1)
        assert away.min() < 2e-3, f"Failure {row} is in no mode."
    assert all("The ego brakes at up to " in words for words in found.words)


def test_the_vehicle_struck_comes_from_the_scenes_of_the_failures(store: Store) -> None:
    """The first vehicle ahead, the second one behind, in six failures each."""
    made = running(store, episodes=60)
    for index in range(1, 13):
        crash = collision(index, steps=20)
        vehicles = np.zeros((21, 3, 4), np.float32)
        vehicles[:, :, 3] = 20.0
        vehicles[:, 1, :2], vehicles[:, 2, :2] = (40.0, 0.0), (-40.0, 0.0)
        vehicles[-1, 1 + index % 2, 0] = -10.0 if index % 2 else 10.0
        sizes = np.array([(16.0, 2.5), (5.0, 2.0), (5.0, 2.0)], np.float32)
        scene = msgspec.structs.replace(crash.scene, vehicles=vehicles, sizes=sizes)
        deliver(store, made, msgspec.structs.replace(crash, scene=scene))
    found = analysed(store, made.id)
    assert found.behaviour.struck == (2, 1) * 6
    assert sorted(words.split(". ")[0].partition(": ")[2] for words in found.words) == [
        "The front of the ego collides with vehicle 1",
        "The rear of the ego collides with vehicle 2",
    ]


def test_without_the_scene_of_a_failure_its_noise_groups_all_and_a_note_says_so(
    store: Store,
) -> None:
    one = campaign(store, *range(1, 12))
    deliver(store, store.campaigns.get(one), result(30, Outcome.COLLISION, steps=20))
    found = analysed(store, one)
    assert (found.features, found.behaviour) == ("energy", None)
    assert found.notes[1] == (
        "The failures were grouped by the energy of their noise in windows of 0.5 s: the speed of "
        "the ego is not known for all of them."
    )
    asked = analysed(store, one, AnalysisSettings(features="noise", bootstrap=0))
    assert (asked.features, asked.notes[1:]) == ("noise", ())


def test_failures_that_need_not_end_in_a_collision_are_compared_from_the_start(
    store: Store,
) -> None:
    made = running(store, episodes=60, requirements=(TimeHeadway(),))
    crashes = [collision(index, steps=20, requirements=(-0.5,)) for index in range(1, 12)]
    deliver(store, made, *crashes)
    one = made.id
    found = analysed(store, one)
    assert found.features == "behaviour"
    assert found.behaviour.origin == "start"
    assert found.behaviour.times_s[0] == pytest.approx(0.1)
    assert len(found.behaviour.times_s) == len(found.influence)
    # Times to a collision are told for none of them.
    assert {each.before_collision_s for each in found.moments} == {None}


def test_failures_of_a_function_are_grouped_by_their_noise_without_a_note(store: Store) -> None:
    _, analysis = analyse_function(store, ("gust", "drift"))
    found = store.analyses.get(analysis).result
    assert (found.features, found.behaviour) == ("noise", None)
    assert not any("grouped" in note for note in found.notes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenario": "lead_brake"}, "episodes of another number of steps"),
        ({"disturbance": DisturbanceModel(scale=2.0)}, "another disturbance model"),
        ({"disturbance": DisturbanceModel(shape=Correlated())}, "another disturbance"),
    ],
)
def test_noise_that_cannot_stand_side_by_side_is_refused(store: Store, changes, words) -> None:
    one, other = campaign(store, 3), campaign(store, 3, **changes)
    settings = AnalysisSettings(campaigns=(other,))
    assert words in problem(store, one, settings)
    with pytest.raises(InvalidValue, match="campaigns: campaign 2 has"):
        find_basis(store, one, settings)


def test_noise_of_other_channels_cannot_stand_side_by_side(store: Store) -> None:
    one, same, other = (running(store, **name_channels(count)).id for count in (3, 3, 1))
    find_basis(store, one, AnalysisSettings(campaigns=(same,)))
    with pytest.raises(InvalidValue, match="campaign 3 has noise with other channels"):
        find_basis(store, one, AnalysisSettings(campaigns=(other,)))


def test_calls_of_a_function_have_no_collision_to_align_at(store: Store) -> None:
    road, function = running(store).id, running(store, **name_channels(2)).id
    settings = AnalysisSettings(align="collision")
    find_basis(store, road, settings)
    with pytest.raises(InvalidValue, match="end at their last step") as refused:
        find_basis(store, function, settings)
    assert refused.value.field == "align"


def test_campaigns_of_different_worlds_are_told(store: Store) -> None:
    one, other = campaign(store, 3, 4, 5), campaign(store, 3, 6, planner="idm")
    found = analysed(store, one, AnalysisSettings(campaigns=(other,), bootstrap=0))
    assert found.notes[0].startswith("The campaigns differ in planner:")


def test_campaigns_that_are_not_there_are_refused(store: Store) -> None:
    one = campaign(store, 3)
    assert "99" in problem(store, one, AnalysisSettings(campaigns=(99,)))
    with pytest.raises(NotFound):
        find_basis(store, 99, QUICK)


def test_without_failures_or_with_settings_of_another_clusterer_it_fails_in_words(
    store: Store,
) -> None:
    assert "none to analyse" in problem(store, campaign(store))
    wrong = AnalysisSettings(clusters=3, clusterer="hdbscan")
    assert "hdbscan finds the number" in problem(store, campaign(store, 3), wrong)


@pytest.mark.fault(
    "SIGKILL of an analysis",
    group="processes",
    outcome="The analysis starts again; five starts in all, and nothing of it is stored until it "
    "is complete.",
)
def test_a_job_that_was_killed_is_started_anew_and_nothing_is_half_written(tmp_path) -> None:
    url = f"sqlite:///{tmp_path / 'eigenfail.db'}"
    store = open_store(url)
    analysis = store.analyses.create(campaign(store, *range(1, 12)), QUICK).id
    store.jobs.claim("campaigns", 30.0, JobKind.CAMPAIGN)
    job = store.jobs.claim("one", 30.0, JobKind.ANALYSIS)
    assert job is not None
    analyses = AnalysisJobs(store, url)
    analyses.open(job)
    (started,) = analyses._running
    started.process.kill()
    started.process.wait()
    analyses.poll()
    assert len(analyses) == 0
    left = store.analyses.get(analysis)
    assert (left.result, left.state in {"queued", "running"}) == (None, True)
    again = store.jobs.claim("other", 30.0, JobKind.ANALYSIS)
    assert (again.subject, again.attempts) == (analysis, 2)
    run_analysis(store, again.subject)
    assert store.analyses.get(analysis).state is AnalysisState.DONE
    store.close()


def test_what_nobody_foresaw_is_told_with_its_reason_and_the_log(store, monkeypatch) -> None:
    def broken(*_arguments) -> None:
        raise ZeroDivisionError("a bug of ours")

    monkeypatch.setattr(module, "find_modes", broken)
    analysis = store.analyses.create(campaign(store, 3), QUICK).id
    with pytest.raises(ZeroDivisionError):
        run_analysis(store, analysis)
    told = store.analyses.get(analysis).problem
    assert told.startswith("The analysis failed with ZeroDivisionError: a bug of ours. ")
    assert "services.log" in told
    assert told.endswith("Launch it again.")


class Ended(Process):
    """Ended with status 1."""

    def poll(self) -> int:
        return 1


@pytest.mark.parametrize("reason", ["", "It broke off."])
def test_a_process_that_ended_badly_leaves_its_own_reason_or_names_the_log(
    store, monkeypatch, reason
) -> None:
    monkeypatch.setattr(module.subprocess, "Popen", Ended)
    analysis = store.analyses.create(campaign(store, 3), QUICK).id
    if reason:
        store.analyses.fail(analysis, reason)
    analyses = AnalysisJobs(store, "memory://")
    analyses.open(Job(1, JobKind.ANALYSIS, analysis, "token", 1))
    analyses.poll()
    told = store.analyses.get(analysis)
    assert told.state is AnalysisState.FAILED
    assert told.problem == (reason or f"The analysis process ended with status 1. {module.LOOK}")


@pytest.mark.fault("no process available for a learner or an analysis")
def test_one_for_which_there_is_no_process_is_failed_in_words(store, monkeypatch) -> None:
    def refused(*_words, **_named) -> Process:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(module.subprocess, "Popen", refused)
    analysis = store.analyses.create(campaign(store, 3), QUICK).id
    job = store.jobs.claim("one", 30.0, JobKind.ANALYSIS)
    analyses = AnalysisJobs(store, "memory://")
    analyses.open(job)
    assert len(analyses) == 0
    told = store.analyses.get(analysis)
    assert told.state is AnalysisState.FAILED
    assert "could not be started: Resource temporarily unavailable. Give" in told.problem
    assert not store.jobs.waiting(JobKind.ANALYSIS)


LINGERING = """
import sys, threading, time
from eigenfail_services import __main__ as program
from eigenfail_services.campaigns import analysis_jobs

def found(store, analysis):
    threading.Thread(target=time.sleep, args=(600.0,)).start()
    {found}

analysis_jobs.find_modes = found
sys.argv = ["eigenfail_services", "--database", sys.argv[1], "analyse", "1"]
program.main()
"""


@pytest.mark.parametrize(
    ("found", "status", "told"),
    [
        ("raise ValueError('a bug')", 1, "failed with ValueError: a bug"),
        ("from eigenfail.errors import InvalidValue; raise InvalidValue('x', 'is odd.')", 0, "odd"),
        ("from eigenfail.errors import ServiceError; raise ServiceError('Busy.', 'Wait.')", 3, ""),
    ],
)
def test_a_thread_that_a_planner_left_behind_does_not_keep_the_process(
    tmp_path, found, status, told
) -> None:
    url = f"sqlite:///{tmp_path / 'a.db'}"
    store = open_store(url)
    store.analyses.create(campaign(store, 3), QUICK)
    script = LINGERING.format(found=found)
    command = [sys.executable, "-c", script, url]
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=deadlines.PROCESS_S, check=False
    )
    assert ended.returncode == status, ended.stderr
    assert told in store.analyses.get(1).problem
    store.close()


@pytest.fixture
def hanging(tmp_path, monkeypatch):
    """An analysis whose process hangs, and so does what it started; the test has its clock."""
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/started\nwait\n")
    script.chmod(0o700)
    monkeypatch.setattr(module.sys, "executable", str(script))
    now_s = [0.0]
    monkeypatch.setattr(module, "Timeout", lambda limit_s: Timeout(limit_s, lambda: now_s[0]))
    return now_s


@pytest.mark.fault("learner or analysis that exhausts memory")
@pytest.mark.fault(
    "analysis that hangs",
    group="time",
    outcome="It is killed after an hour with all that it started, and fails with the reason.",
)
@pytest.mark.service
def test_one_that_hangs_is_killed_with_all_it_started_and_failed_in_words(
    store, tmp_path, hanging
) -> None:
    analysis = store.analyses.create(campaign(store, 3), QUICK).id
    store.jobs.claim("campaigns", 30.0, JobKind.CAMPAIGN)
    job = store.jobs.claim("one", 30.0, JobKind.ANALYSIS)
    analyses = AnalysisJobs(store, "", SettingBounds(time_s=5.0, memory_mib=300.0))
    analyses.open(job)
    (running,) = analyses._running
    most, _ = resource.prlimit(running.process.pid, resource.RLIMIT_DATA)
    assert most == 300 * 1024 * 1024
    until("it starts nothing", lambda: (tmp_path / "started").exists() and started(tmp_path))
    process = psutil.Process(started(tmp_path))
    for _ in range(6):
        analyses.poll()
        assert len(analyses) == 1
        hanging[0] += 1.0
    analyses.poll()
    assert (len(analyses), running.process.returncode) == (0, -9)
    until("what it started lives on", lambda: not lives(process))
    failed = store.analyses.get(analysis)
    assert failed.state is AnalysisState.FAILED
    assert failed.problem.startswith("The analysis took more than 5 s, and was broken off.")
    assert "--analysis-limit" in failed.problem
    assert store.jobs.claim("other", 30.0, JobKind.ANALYSIS) is None


@pytest.mark.fault(
    "processes left behind by a learner or an analysis",
    group="processes",
    outcome="They are killed with it, however it ended.",
)
@pytest.mark.service
@pytest.mark.parametrize(("end", "status"), [("exit 0", 0), ("exit 1", 1), ("kill -9 $$", -9)])
def test_what_one_started_goes_with_it_however_it_ended(
    store, tmp_path, monkeypatch, end, status
) -> None:
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/started\n{end}\n")
    script.chmod(0o700)
    monkeypatch.setattr(module.sys, "executable", str(script))
    analysis = store.analyses.create(campaign(store, 3), QUICK).id
    analyses = AnalysisJobs(store, "")
    analyses.open(Job(1, JobKind.ANALYSIS, analysis, "token", 1))
    (running,) = analyses._running

    def is_over() -> bool:
        analyses.poll()
        return len(analyses) == 0

    until("it does not end", is_over)
    assert running.process.returncode == status
    until("what it started lives on", lambda: is_gone(started(tmp_path)))


def is_gone(pid: int) -> bool:
    try:
        return not lives(psutil.Process(pid))
    except psutil.NoSuchProcess:
        return True


def started(folder) -> int:
    return int((folder / "started").read_text() or 0)


def lives(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def until(problem: str, holds) -> None:
    deadline_s = time.monotonic() + deadlines.PROCESS_S
    while not holds():
        assert time.monotonic() < deadline_s, problem
        time.sleep(0.01)
