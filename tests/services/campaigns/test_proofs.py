"""Proof by replay, minimal failures and words for modes, on campaigns that are run here."""

import os
from collections.abc import Iterator
from hashlib import sha256
from threading import Event

import msgspec
import numpy as np
import pytest
from accepted import accept_spec
from campaigns_here import run_here
from resolved import resolve_campaign
from store_checks.examples import name_channels, running

from eigenfail import plugins
from eigenfail.errors import Conflict, InvalidValue, LearnerFailed
from eigenfail.process_state import ProcessState
from eigenfail.testing.examples import analysis_result
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import TrajectorySource, episode_seed
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep, NearestFailure
from eigenfail.worlds import drawn_for, list_channels
from eigenfail_services.campaigns import explanations as words_module
from eigenfail_services.campaigns import minimal_failures
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.minimal_failures import find_minimal_failure, read_knowledge
from eigenfail_services.campaigns.proofs import (
    launch_replays,
    list_neighbours,
    summarise_proof,
)
from eigenfail_services.campaigns.references import check_references
from eigenfail_services.methods.minimal import MinimalFacts
from eigenfail_services.methods.minimal_search import SearchPhase
from eigenfail_services.methods.nearest import mix_noise
from eigenfail_services.store.store import open_store
from eigenfail_workers.scenarios.cut_in import CutIn, CutInParameters, CutInSituation

WORLD = {"planner": "idm", "simulator": "point_mass"}


class House:
    """A store, and campaigns that are run in this process as the service runs them."""

    def __init__(self) -> None:
        self.store = open_store("memory://")

    def create(self, **fields) -> int:
        given = {"name": "t", "method": "monte_carlo", "episodes": 30} | WORLD | fields
        spec = CampaignSpec(**given)
        check_references(resolve_campaign(spec), self.store)
        return self.store.campaigns.create(accept_spec(spec)).id

    def finish(self, number: int) -> int:
        return run_here(self.store, number)

    def run(self, **fields) -> int:
        return self.finish(self.create(**fields))

    def analysed(self, campaign: int, **settings) -> int:
        noise = {"clusters": 2, "bootstrap": 0, "features": "noise"}
        few = AnalysisSettings(**noise | settings)
        analysis = self.store.analyses.create(campaign, few).id
        run_analysis(self.store, analysis)
        return analysis

    def failures(self, campaign: int) -> list:
        every = self.store.episodes.finished(campaign, range(1000))
        return [result for result in every if result.is_failure]


@pytest.fixture(scope="module")
def house() -> Iterator[House]:
    """Thirty-odd failures of a planner that fails often, analysed once for all tests."""
    house = House()
    house.campaign = house.run(episodes=40, seed=3)
    house.analysis = house.analysed(house.campaign)
    analysis = house.store.analyses.get(house.analysis)
    for scenario in launch_replays(house.store, analysis, None).scenarios:
        house.finish(scenario.campaign)
    yield house
    house.store.close()


def test_every_medoid_fails_again_where_it_was_found_and_everything_is_told(house) -> None:
    analysis = house.store.analyses.get(house.analysis)
    told = summarise_proof(house.store, analysis)
    assert told.done
    assert [each.scenario_parameters for each in told.scenarios] == [
        {},
        {"distance_m": 53.0},
        {"distance_m": 63.0},
    ]
    same = told.scenarios[0]
    assert (same.medoids.rate.k, same.medoids.rate.n) == (2, 2)
    assert told.eigenfailures.rate.n == told.medoids.rate.n == 6
    for replay in same.replays[2:]:
        medoid = analysis.result.modes[replay.mode].medoid
        stored = house.store.episodes.get(house.campaign, medoid)
        again = house.store.episodes.get(replay.campaign, replay.index)
        assert again.digest() == stored.digest()
        assert replay.log_probability == stored.noise.log_probability


class Restless(CutIn):
    """`cut_in`, where the seed draws the distance, as the traffic of other worlds is drawn."""

    def __call__(self, parameters: CutInParameters, seed: int) -> CutInSituation:
        drawn_m = float(np.random.default_rng(seed).uniform(52.0, 70.0))
        return super().__call__(msgspec.structs.replace(parameters, distance_m=drawn_m), seed)


@pytest.fixture
def restless(monkeypatch) -> Iterator[House]:
    """Failures in a scenario that draws more than its parameters."""
    load = plugins.load
    monkeypatch.setattr(
        plugins, "load", lambda group, name: Restless if name == "restless" else load(group, name)
    )
    house = House()
    house.campaign = house.run(episodes=40, seed=3, scenario="restless")
    yield house
    house.store.close()


def test_replays_meet_what_the_scenario_drew_for_the_episode(restless) -> None:
    store, failures = restless.store, restless.failures(restless.campaign)
    assert 5 < len(failures) < 40
    wanted = [failure.digest() for failure in failures]
    whole = restless.run(
        method="replay",
        settings={"campaign": restless.campaign},
        scenario="restless",
        episodes=len(failures),
    )
    found = store.episodes.finished(whole, range(len(failures)))
    assert [each.digest() for each in sorted(found, key=lambda each: each.index)] == wanted
    last = len(failures) - 1
    (again,) = restless.failures(
        restless.run(
            method="replay",
            settings={"campaign": whole, "episodes": [last]},
            scenario="restless",
            episodes=1,
        )
    )
    assert (again.index, again.seed, again.digest()) == (0, failures[-1].seed, wanted[-1])


def test_modes_and_shrunk_failures_are_proven_in_what_their_seeds_drew(restless) -> None:
    analysis = restless.store.analyses.get(restless.analysed(restless.campaign))
    (same,) = launch_replays(restless.store, analysis, [{}]).scenarios
    restless.finish(same.campaign)
    proof = summarise_proof(restless.store, analysis)
    assert (proof.medoids.rate.k, proof.medoids.rate.n) == (2, 2)
    seeds = [
        restless.store.episodes.get(restless.campaign, mode.medoid).seed
        for mode in analysis.result.modes
    ]
    replayed = restless.store.episodes.finished(same.campaign, range(4))
    # The eigenfailure of a mode, too, is replayed in the scenario of its medoid.
    assert [each.seed for each in sorted(replayed, key=lambda each: each.index)] == seeds * 2
    failure = restless.failures(restless.campaign)[-1]
    settings = {"campaign": restless.campaign, "episode": failure.index}
    number = restless.run(
        method="minimal", settings=settings, episodes=300, scenario="restless", seed=99
    )
    told = find_minimal_failure(restless.store, restless.store.campaigns.get(number))
    assert told.full_log_probability == failure.noise.log_probability
    assert restless.store.episodes.get(number, told.index).seed == failure.seed
    searching = launch_replays(restless.store, analysis, [{}])
    (search,), (mode,) = searching.searches, searching.unplaced
    restless.finish(search)
    found = restless.store.episodes.finished(search, range(20))
    assert {each.seed for each in found} == {seeds[mode]}


def test_where_a_centre_does_not_fail_the_nearest_failing_point_is_searched() -> None:
    house = House()
    campaign = house.run(episodes=40, seed=3)
    analysis = house.store.analyses.get(house.analysed(campaign))
    for scenario in launch_replays(house.store, analysis, [{}]).scenarios:
        assert launch_replays(house.store, analysis, [{}]).searches == ()  # they have not ended
        house.finish(scenario.campaign)
    proof = summarise_proof(house.store, analysis)
    assert (proof.done, proof.unplaced) == (True, (0,))
    assert [mode.nearest for mode in proof.modes] == [None, NearestFailure(0.0, 2, 1)]
    (search,) = launch_replays(house.store, analysis, [{}]).searches
    assert launch_replays(house.store, analysis, [{}]).searches == (search,)
    house.finish(search)
    proof = summarise_proof(house.store, analysis)
    assert (proof.done, proof.unplaced) == (True, ())
    nearest, centre = (mode.nearest for mode in proof.modes)
    assert centre.words == "t = 0: the centre itself fails"
    episode = house.store.episodes.get(nearest.campaign, nearest.index)
    mode = analysis.result.modes[0]
    medoid = house.store.episodes.get(campaign, mode.medoid).noise.z
    medoid = np.pad(medoid, ((0, len(mode.eigenfailure) - len(medoid)), (0, 0)))
    ends = TrajectorySource(mode.eigenfailure), TrajectorySource(medoid)
    mixed = mix_noise(*ends, nearest.t).z
    assert episode.is_failure
    assert 0.0 < nearest.t < 1.0
    assert np.allclose(episode.noise.z, mixed[: len(episode.noise.z)], atol=1e-6)
    below = house.store.episodes.finished(search, range(20))
    assert all(not each.is_failure for each in below if each.index == 0)


QUEUED_BEFORE = (
    '{"name":"t: replay of analysis 1","method":"replay","episodes":4,"seed":3,'
    '"settings":{"analysis":1,"what":["eigenfailure","medoid"]},"scenario":"cut_in",'
    '"scenario_parameters":{},"planner":"idm","planner_settings":{},"simulator":"point_mass",'
    '"disturbance":{"longitudinal_slope":0.02,"longitudinal_base_m":1.0,"lateral_slope":0.00625,'
    '"lateral_base_m":0.2,"scale":1.0,"shape":{"kind":"white"}},"stop":{"failures":null,'
    '"half_width":null,"cv":null,"wall_s":null,"cost_usd":null},"price_usd_per_hour":1.2,'
    '"instances":1,"scene_every":1}'
)
"""A replay as earlier releases wrote it down."""


def test_a_proof_that_an_earlier_release_queued_is_not_queued_again(house) -> None:
    assert house.analysis == 1
    (same, *_) = summarise_proof(house.store, house.store.analyses.get(1)).scenarios
    replay = house.store.campaigns.get(same.campaign)
    key = f"replay 0 of analysis 1: {sha256(QUEUED_BEFORE.encode()).hexdigest()}"
    assert house.store.campaigns.create(accept_spec(replay.spec), key).id == replay.id


def test_the_words_of_a_mode_name_its_medoid_and_agree_with_its_noise(house) -> None:
    result = house.store.analyses.get(house.analysis).result
    assert len(result.words) == len(result.modes) == 2
    for number, (mode, words) in enumerate(zip(result.modes, result.words, strict=True), start=1):
        assert words.startswith(f"Mode {number}: L")
        assert f"Its medoid is episode {house.campaign}/{mode.medoid}" in words
        assert "before its medoid's impact" in words or "stays within" in words


def explained_by_rule(monkeypatch) -> None:
    """Planners give an account from now on."""
    real = plugins.load

    def told(setup, task):
        (result,) = real(plugins.ENGINES, "default")(setup).run([task])
        step = ExplainedStep(0.0, 0.0, 0.0, {"rule": "keep_gap"}, (0.0, 0.0))
        return ExplainedEpisode(result, (step,) * result.steps)

    def load(group, name):
        return told if group == plugins.EXPLAINERS else real(group, name)

    monkeypatch.setattr(words_module.plugins, "load", load)


def test_the_account_of_the_planner_stands_there_where_it_gives_one(house, monkeypatch) -> None:
    explained_by_rule(monkeypatch)
    analysis = house.store.analyses.get(house.analysis)
    told_words = words_module.describe_modes(house.store, analysis, analysis.result, 0.1)
    assert all("the planner's rules that decided: keep gap in " in words for words in told_words)


def test_without_workers_there_are_words_without_the_planner(house, monkeypatch) -> None:
    def load(group, name):
        raise InvalidValue("explainer", "'default' cannot be loaded: No module named 'osqp'.")

    monkeypatch.setattr(words_module.plugins, "load", load)
    analysis = house.store.analyses.get(house.analysis)
    for words in words_module.describe_modes(house.store, analysis, analysis.result, 0.1):
        assert words.endswith(f"{house.campaign}/{words.rsplit('/', 1)[1]}")
        assert "rules that decided" not in words


def test_a_planner_that_never_answers_is_asked_once_and_not_waited_for(house, monkeypatch) -> None:
    forever, asked = Event(), []

    def ask(_setup, task):
        asked.append(task.index)
        forever.wait(5.0)
        raise InvalidValue("episode", "nothing to tell")

    monkeypatch.setattr(words_module, "PATIENCE_S", 0.2)
    monkeypatch.setattr(words_module.plugins, "load", lambda *_: ask)
    analysis = house.store.analyses.get(house.analysis)
    words = words_module.describe_modes(house.store, analysis, analysis.result, 0.1)
    forever.set()
    assert (len(words), asked) == (2, [analysis.result.modes[0].medoid])


@pytest.mark.fault(
    "planner that changes the process of an analysis",
    group="plug-ins",
    outcome="What the account of a planner changed is restored before the analysis goes on.",
)
def test_what_a_planner_changes_while_it_is_asked_is_restored(house, monkeypatch) -> None:
    def ask(_setup, _task):
        os.chdir("/")
        raise InvalidValue("episode", "nothing to tell")

    monkeypatch.setattr(words_module.plugins, "load", lambda *_: ask)
    before = ProcessState()
    analysis = house.store.analyses.get(house.analysis)
    assert len(words_module.describe_modes(house.store, analysis, analysis.result, 0.1)) == 2
    assert before.changes() == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_account_that_cannot_be_told_fails_no_analysis(house, monkeypatch) -> None:
    def broken(*_):
        raise ZeroDivisionError

    explained_by_rule(monkeypatch)
    monkeypatch.setattr(words_module, "describe_account", broken)
    analysis = house.store.analyses.get(house.analysis)
    for words in words_module.describe_modes(house.store, analysis, analysis.result, 0.1):
        assert "Its medoid is episode" in words


def test_a_failure_is_shrunk_to_what_it_needs(house) -> None:
    failure = house.failures(house.campaign)[0]
    settings = {"campaign": house.campaign, "episode": failure.index}
    number = house.run(method="minimal", settings=settings, episodes=3_000)
    told = find_minimal_failure(house.store, house.store.campaigns.get(number))
    assert told.done
    assert told.needed < told.injected == np.count_nonzero(failure.noise.z)
    assert told.energy < told.full_energy
    assert told.full_log_probability == failure.noise.log_probability
    _, z = read_knowledge(house.store, house.store.campaigns.get(number))
    found = house.store.episodes.get(number, told.index).noise.z
    np.testing.assert_array_equal(found, z[: len(found)])
    assert not z[len(found) :].any()
    assert house.store.episodes.get(number, told.index).is_failure
    assert told.because.startswith(("No step of one axis can be left out.", "It fails without"))


@pytest.mark.parametrize(("fields", "word"), [({}, "axis"), (name_channels(2), "channel")])
def test_what_is_needed_is_told_of_axes_on_roads_and_of_channels_elsewhere(fields, word) -> None:
    facts = MinimalFacts(
        phase=SearchPhase.OVER,
        width=1,
        removable=(),
        low=0.0,
        high=1.0,
        scaled=True,
        not_run=0,
        ends=(),
        tried=3,
        best=0,
    )
    campaign = running(open_store("memory://"), **fields)
    channels = list_channels(campaign.spec)
    told = minimal_failures._describe_progress(facts, np.ones((3, 2)), campaign, channels)
    assert told == f"No step of one {word} can be left out."


def test_an_eigenfailure_is_shrunk_too_and_a_short_budget_is_told(house) -> None:
    modes = house.store.analyses.get(house.analysis).result.modes
    known = (
        summarise_proof(house.store, house.store.analyses.get(house.analysis)).scenarios[0].replays
    )
    mode = next(each.mode for each in known[: len(modes)] if each.reproduced)
    settings = {"analysis": house.analysis, "mode": mode + 1}
    number = house.run(method="minimal", settings=settings, episodes=5)
    told = find_minimal_failure(house.store, house.store.campaigns.get(number))
    assert not told.done
    assert told.because.startswith("It was cut short at blocks of ")


VARIED = {"distance_m": {"choice": [53.0, 58.0, 63.0]}}


@pytest.fixture(scope="module")
def varied() -> Iterator[House]:
    """Failures of a scenario whose distance varies, analysed and replayed."""
    house = House()
    house.campaign = house.run(episodes=40, seed=3, scenario_parameters=VARIED)
    house.analysis = house.store.analyses.get(house.analysed(house.campaign, clusters=6))
    for scenario in launch_replays(
        house.store, house.analysis, [{}, {"lane_change_s": 3.1}]
    ).scenarios:
        house.finish(scenario.campaign)
    yield house
    house.store.close()


def test_where_the_scenario_varies_each_mode_is_replayed_in_what_its_medoid_drew(varied) -> None:
    told = summarise_proof(varied.store, varied.analysis)
    assert told.done
    same = [each for each in told.scenarios if each.is_same]
    assert len(same) == len(told.scenarios) / 2 > 1
    again = [replay for each in same for replay in each.replays if replay.what == "medoid"]
    assert sorted(replay.mode for replay in again) == list(range(6))
    for replay in again:
        medoid = varied.analysis.result.modes[replay.mode].medoid
        stored = varied.store.episodes.get(varied.campaign, medoid)
        result = varied.store.episodes.get(replay.campaign, replay.index)
        assert (result.steps, result.measures) == (stored.steps, stored.measures)
    assert told.reproduced.rate.n == 6
    others = [each.scenario_parameters for each in told.scenarios if not each.is_same]
    assert others == [{"lane_change_s": 3.1}] * len(same)
    mode = again[0].mode
    assert told.modes[mode].medoid.rate.n == told.modes[mode].eigenfailure.rate.n == 2
    before = len(varied.store.campaigns.page(100).items)
    searching = launch_replays(varied.store, varied.analysis, None)
    assert (searching.scenarios, searching.modes) == (told.scenarios, told.modes)
    # Each centre that did not fail is searched in what the medoid of its mode drew.
    assert len(searching.searches) == len(told.unplaced)
    for search in searching.searches:
        spec = varied.store.campaigns.get(search).spec
        (number,) = spec.settings["modes"]
        mode = varied.analysis.result.modes[number - 1]
        drawn = mode.drawn
        assert spec.scenario_parameters.items() >= drawn.items()
    assert len(varied.store.campaigns.page(100).items) == before + len(searching.searches)


def test_replays_in_a_varying_scenario_draw_scenarios_of_their_own(varied) -> None:
    settings = {"campaign": varied.campaign}
    number = varied.run(method="replay", settings=settings, scenario_parameters=VARIED, seed=8)
    found = varied.store.episodes.finished(number, range(30))
    assert [each.seed for each in sorted(found, key=lambda each: each.index)] == [
        episode_seed(8, i) for i in range(len(varied.failures(varied.campaign)))
    ]


def test_an_analysis_that_does_not_know_the_draws_is_not_proved(varied) -> None:
    result = varied.analysis.result
    modes = tuple(msgspec.structs.replace(mode, drawn={}) for mode in result.modes)
    unknown = msgspec.structs.replace(
        varied.analysis, result=msgspec.structs.replace(result, modes=modes)
    )
    with pytest.raises(Conflict, match="ran without scenario 'cut_in' installed"):
        launch_replays(varied.store, unknown, None)


def test_each_draw_is_told_by_name(varied) -> None:
    told = summarise_proof(varied.store, varied.analysis)
    for scenario in told.scenarios:
        for replay in scenario.replays:
            mode = varied.analysis.result.modes[replay.mode]
            medoid = varied.store.episodes.get(varied.campaign, mode.medoid)
            spec = varied.store.campaigns.get(varied.campaign).spec
            assert scenario.drawn == mode.drawn == drawn_for(spec, medoid.seed)
        (distance_m,) = scenario.drawn.values()
        told_as = "the same" if scenario.is_same else "lane_change_s = 3.1"
        assert scenario.words == f"{told_as} (drawn: distance_m = {distance_m:g})"
    assert len({scenario.words for scenario in told.scenarios}) == len(told.scenarios)


def test_what_is_put_over_a_draw_is_not_told_as_drawn(varied) -> None:
    for scenario in launch_replays(varied.store, varied.analysis, [{"distance_m": 60.5}]).scenarios:
        if scenario.scenario_parameters == {"distance_m": 60.5}:
            assert (scenario.drawn, scenario.words) == ({}, "distance_m = 60.5")
            break
    else:
        pytest.fail("The variation was not launched.")


def test_a_proof_is_not_worked_out_again_until_more_of_it_is_in(house, monkeypatch) -> None:
    analysis = house.store.analyses.get(house.analysis)
    late = launch_replays(house.store, analysis, [{"distance_m": 57.25}]).scenarios[-1]
    before = summarise_proof(house.store, analysis)
    assert (before.done, before.scenarios[-1].eigenfailures.rate) == (False, None)
    read, finished = [], house.store.episodes.finished

    def note(campaign, indices):
        read.append(campaign)
        return finished(campaign, indices)

    monkeypatch.setattr(house.store.episodes, "finished", note)
    assert summarise_proof(house.store, analysis) == before
    assert read == []
    house.finish(late.campaign)
    read.clear()
    after = summarise_proof(house.store, analysis)
    assert read == [late.campaign]
    assert (after.done, after.scenarios[-1].eigenfailures.rate.n) == (True, 2)


@pytest.mark.parametrize("given", [{"uniform": [52, 60]}, VARIED["distance_m"]])
def test_a_variation_that_draws_is_refused(house, varied, given) -> None:
    for analysis in (house.store.analyses.get(house.analysis), varied.analysis):
        store = varied.store if analysis is varied.analysis else house.store
        with pytest.raises(InvalidValue, match=r"is a distribution.*Give it a value") as refused:
            launch_replays(store, analysis, [{}, {"distance_m": given}])
        assert refused.value.field == "variations[1].distance_m"


def test_a_variation_with_other_channels_is_refused(monkeypatch) -> None:
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "m")
    store = open_store("memory://")
    analysed = running(store, **name_channels(3))
    analysis = store.analyses.create(analysed.id, AnalysisSettings()).id
    store.analyses.finish(analysis, analysis_result())
    variations = [{"limit_s": 5.0}, {"channels": ["c0"]}]
    with pytest.raises(InvalidValue, match="not those of the noise that was analysed") as refused:
        launch_replays(store, store.analyses.get(analysis), variations)
    assert refused.value.field == "variations[1].channels"
    assert not store.analyses.replays(analysis)
    launch_replays(store, store.analyses.get(analysis), variations[:1])
    assert len(store.analyses.replays(analysis)) == 1


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"scenario_parameters": {"distance_m": 52.0}}, "scenario_parameters"),
        ({"planner_settings": {"lane_half_width_m": 2.5}}, "planner_settings"),
    ],
)
def test_an_analysis_of_several_worlds_is_not_proven(fields, told) -> None:
    house = House()
    one, other = house.run(seed=3), house.run(seed=4, **fields)
    analysis = house.store.analyses.get(house.analysed(one, campaigns=(other,)))
    with pytest.raises(Conflict, match=f"differ in {told}.*Analyse each campaign by itself"):
        launch_replays(house.store, analysis, None)
    house.store.close()


def test_campaigns_of_one_world_are_proven_together_whatever_they_spell_out() -> None:
    house = House()
    other = house.run(seed=4, scenario_parameters={"distance_m": 58.0})
    analysis = house.analysed(house.run(seed=3), campaigns=(other,))
    (same,) = launch_replays(house.store, house.store.analyses.get(analysis), [{}]).scenarios
    house.finish(same.campaign)
    told = summarise_proof(house.store, house.store.analyses.get(analysis))
    assert (told.medoids.rate.k, told.medoids.rate.n) == (2, 2)
    house.store.close()


def test_a_varying_scenario_is_none_to_shrink_in(varied) -> None:
    failure = varied.failures(varied.campaign)[0]
    for settings in (
        {"campaign": varied.campaign, "episode": failure.index},
        {"analysis": varied.analysis.id, "mode": 1},
    ):
        with pytest.raises(InvalidValue, match="eigenfail episode shrink") as refused:
            varied.create(method="minimal", settings=settings, scenario_parameters=VARIED)
        assert refused.value.field == "scenario_parameters.distance_m"


@pytest.mark.parametrize(
    ("method", "settings", "field"),
    [
        ("minimal", {}, "settings"),
        ("minimal", {"campaign": 1}, "settings"),
        ("minimal", {"analysis": 1}, "settings"),
        ("minimal", {"episode": 3}, "settings"),
        ("minimal", {"mode": 3}, "settings"),
        ("minimal", {"campaign": 1, "episode": 3, "analysis": 1}, "settings"),
        ("replay", {}, "settings"),
        ("replay", {"campaign": 99}, "settings.campaign"),
        ("replay", {"campaign": 1, "episodes": [5000]}, "settings.episodes"),
        ("replay", {"analysis": 1, "modes": [1, 9]}, "settings.modes"),
    ],
)
def test_a_campaign_without_noise_to_inject_is_refused(house, method, settings, field) -> None:
    with pytest.raises(InvalidValue) as refused:
        house.create(method=method, settings=settings)
    assert refused.value.field == field
    assert refused.value.remedy


def test_an_analysis_to_come_is_not_replayed_yet_but_failures_to_come_are() -> None:
    house = House()
    campaign = house.create()
    assert house.create(method="replay", settings={"campaign": campaign})
    analysis = house.store.analyses.create(campaign, AnalysisSettings()).id
    with pytest.raises(InvalidValue, match=r"is queued and has no eigenfailures.*Wait"):
        house.create(method="replay", settings={"analysis": analysis})
    house.store.close()


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"episode": 999}, "settings.episode", "has no result"),
        ({"campaign": 99}, "settings.campaign", "Campaign 99 does not exist"),
        ({"campaign": None, "analysis": 1, "mode": 9}, "settings.mode", "has 2 modes"),
        (
            {"campaign": None, "analysis": 9, "mode": 1},
            "settings.analysis",
            "Analysis 9 does not exist",
        ),
    ],
)
def test_what_cannot_be_shrunk_is_refused_by_its_field(house, changes, field, problem) -> None:
    given = {"campaign": house.campaign} | changes
    settings = {name: value for name, value in given.items() if value is not None}
    with pytest.raises(InvalidValue, match=problem) as refused:
        house.create(method="minimal", settings=settings)
    assert refused.value.field == field


def test_what_did_not_crash_is_no_failure_to_shrink(house) -> None:
    every = house.store.episodes.finished(house.campaign, range(1000))
    safe = next(result for result in every if not result.is_failure)
    settings = {"campaign": house.campaign, "episode": safe.index}
    with pytest.raises(InvalidValue, match=r"is safe, not a collision.*--outcome collision"):
        house.create(method="minimal", settings=settings)


def test_a_failure_of_another_world_is_refused_and_there_is_no_minimal_one(house) -> None:
    failure = house.failures(house.campaign)[0]
    settings = {"campaign": house.campaign, "episode": failure.index}
    number = house.create(
        method="minimal", settings=settings, scenario_parameters={"distance_m": 70.0}
    )
    with pytest.raises(LearnerFailed, match="does not reproduce at full strength"):
        house.finish(number)
    with pytest.raises(Conflict, match="no replay of it has failed"):
        find_minimal_failure(house.store, house.store.campaigns.get(number))


def test_other_methods_shrink_nothing(house) -> None:
    with pytest.raises(Conflict, match=r"one of monte_carlo, which shrinks no failure"):
        find_minimal_failure(house.store, house.store.campaigns.get(house.campaign))


def spec(**fields) -> CampaignSpec:
    return CampaignSpec(name="t", method="ast", episodes=1, **fields)


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        ({}, ({}, {"distance_m": 53.0}, {"distance_m": 63.0})),
        (
            {"scenario_parameters": {"distance_m": 54.0}},
            ({}, {"distance_m": 52.0}, {"distance_m": 59.0}),
        ),
        ({"scenario_parameters": {"distance_m": 52.0}}, ({}, {"distance_m": 57.0})),
        ({"scenario_parameters": {"distance_m": {"uniform": [54.0, 60.0]}}}, ({},)),
        (
            {
                "scenario_parameters": {"distance_m": {"uniform": [54.0, 60.0]}},
                "disturbance": DisturbanceModel(channels=(Channel("scenario.distance_m"),)),
            },
            ({},),
        ),
        ({"scenario": "lead_brake"}, ({}, {"gap_m": 55.0}, {"gap_m": 65.0})),
        (
            {
                "simulator": "function",
                "scenario": "function",
                "planner": "m:f",
                "scenario_parameters": {"steps": 4},
            },
            ({},),
        ),
    ],
)
def test_neighbours_of_a_scenario_lie_within_its_bounds(fields, wanted) -> None:
    assert list_neighbours(spec(**fields)) == wanted


def test_a_scenario_that_names_no_neighbours_has_some_all_the_same() -> None:
    same, below, above = list_neighbours(spec(scenario="merge_in"))
    assert same == {}
    assert below.keys() == above.keys()
    ((low,), (high,)) = below.values(), above.values()
    assert low < high
