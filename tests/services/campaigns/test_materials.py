"""What a learner is born with of earlier campaigns, over the wire; refused where there is none."""

from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
from accepted import accept_spec
from resolved import resolve_campaign
from store_checks.examples import deliver, name_channels, result_of

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.testing.examples import analysis_result
from eigenfail.values import episode
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState, EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.wire.messages import Start, encode, read_learner_command
from eigenfail_services.campaigns import references
from eigenfail_services.campaigns import references as context_module
from eigenfail_services.campaigns.rounds import run_in_process
from eigenfail_services.hub.learner_process import create_rounds
from eigenfail_services.store.store import open_store

WORLD = {"planner": "idm", "simulator": "point_mass"}
CEM = {"method": "cem", "settings": {"batch": 10}}


def make_spec(**fields) -> CampaignSpec:
    return CampaignSpec(**{"name": "t", "method": "monte_carlo", "episodes": 30} | WORLD | fields)


class House:
    """A store, and campaigns that are run in this process as the service runs them."""

    def __init__(self, store) -> None:
        self.store = store

    def create(self, **fields) -> int:
        spec = make_spec(**fields)
        references.check_references(resolve_campaign(spec), self.store)
        return self.store.campaigns.create(accept_spec(spec)).id

    def context(self, campaign: int):
        return references.learner_context(self.store.campaigns.get(campaign), self.store)

    def forget_form(self, campaign: int):
        """The campaign as it is where its scenario was not installed when it was created."""
        return msgspec.structs.replace(self.store.campaigns.get(campaign), form=EpisodeForm())

    def begun(self, campaign: int):
        """The rounds of a learner that was told over the wire what it is."""
        spec = self.store.campaigns.get(campaign).spec
        checkpoint = self.store.checkpoints.load(campaign)
        context = self.context(campaign)
        start = Start(spec.method, spec.settings, context, spec.seed, checkpoint)
        heard = read_learner_command(encode(start))
        assert isinstance(heard, Start)
        return create_rounds(heard)

    def run(self, **fields) -> int:
        campaign = self.create(**fields)
        self.store.campaigns.move(campaign, CampaignState.RUNNING)
        rounds, setup = self.begun(campaign), self.store.campaigns.get(campaign).spec.setup()
        engine = plugins.load(plugins.ENGINES, "default")(setup)
        for result in run_in_process(rounds, engine):
            self.store.episodes.commit(campaign, [Delivery(result, "w")])
        self.store.checkpoints.save(campaign, rounds.checkpoint())
        self.store.campaigns.move(campaign, CampaignState.DONE)
        return campaign

    def results(self, campaign: int):
        return self.store.episodes.finished(campaign, range(1000))


@pytest.fixture(params=["memory://", "sqlite"])
def house(request, tmp_path) -> Iterator[House]:
    url = request.param if "://" in request.param else f"sqlite:///{tmp_path / 'store.db'}"
    store = open_store(url)
    yield House(store)
    store.close()


@pytest.fixture
def memory() -> House:
    return House(open_store("memory://"))


def test_train_evaluate_and_evaluate_in_another_scenario(house: House) -> None:
    trained = house.run(**CEM, episodes=60, seed=1)
    evaluate = {"method": "evaluate", "settings": {"campaign": trained}, "episodes": 20, "seed": 2}
    here = house.run(**evaluate)
    farther = house.run(**evaluate, scenario_parameters={"distance_m": 63.0})
    again = house.run(**evaluate)

    drawn, there = house.results(here), house.results(farther)
    assert len(drawn) == len(there) == 20
    assert house.store.episodes.digest(again) == house.store.episodes.digest(here)
    for one, other in zip(drawn, there, strict=True):
        shorter = min(one.steps, other.steps)
        np.testing.assert_array_equal(one.noise.z[:shorter], other.noise.z[:shorter])
    earlier = {result.noise.z[0].tobytes() for result in house.results(trained)}
    assert not earlier & {result.noise.z[0].tobytes() for result in drawn}
    centre = house.begun(trained)._learner.proposal.mean
    assert np.mean([np.sum(result.noise.z * centre[: result.steps]) for result in drawn]) > 0


def test_an_evaluation_tells_a_probability_where_the_draws_have_a_density(memory: House) -> None:
    trained = memory.run(**CEM, episodes=40)
    found = memory.begun(memory.run(method="evaluate", settings={"campaign": trained})).estimate()
    assert found.by == "importance sampling"
    stop = StopRules(cv=0.1)
    memory.create(method="evaluate", settings={"campaign": trained}, stop=stop)
    several = {"method": "ensemble", "settings": {"method": "cem", "members": 2}}
    for before in (memory.run(method="ast", episodes=20), memory.run(**several, episodes=20)):
        refused = evaluate(memory, before, stop=stop)
        assert refused.field == "stop.cv"
        assert "estimates no probability" in refused.problem


def test_an_evaluation_that_was_interrupted_goes_on_bit_for_bit(memory: House) -> None:
    trained = memory.run(**CEM, episodes=40)
    evaluate = {"method": "evaluate", "settings": {"campaign": trained, "round_size": 4}}
    whole = memory.results(memory.run(**evaluate, episodes=24))
    interrupted = memory.create(**evaluate, episodes=24)
    rounds = memory.begun(interrupted)
    engine = plugins.load(plugins.ENGINES, "default")(
        memory.store.campaigns.get(interrupted).spec.setup()
    )
    course = run_in_process(rounds, engine)
    digests = [next(course).digest() for _ in range(8)]
    memory.store.checkpoints.save(interrupted, rounds.checkpoint())
    # The generator stands behind its eighth episode, before its round is observed.
    rest = list(run_in_process(memory.begun(interrupted), engine))
    digests = digests[: rest[0].index] + [result.digest() for result in rest]
    assert digests == [result.digest() for result in whole]


def test_a_predecessor_is_what_its_campaign_was_and_knew(memory: House) -> None:
    trained = memory.run(**CEM, episodes=40, seed=9)
    context = memory.context(memory.create(method="evaluate", settings={"campaign": trained}))
    (before,) = context.predecessors
    assert (before.campaign, before.method, before.settings) == (trained, "cem", CEM["settings"])
    assert (before.seed, before.episodes, before.horizon) == (episode.learner_seed(9), 40, 100)
    assert before.state == memory.begun(trained)._learner.state()
    assert len(context.trajectories) == 0


def refusal(house: House, **fields) -> InvalidValue:
    with pytest.raises(InvalidValue) as refused:
        house.create(**fields)
    assert refused.value.remedy
    return refused.value


def evaluate(house: House, campaign: int, **fields) -> InvalidValue:
    return refusal(house, method="evaluate", settings={"campaign": campaign}, **fields)


def test_a_campaign_that_is_not_there_is_refused_by_its_field(memory: House) -> None:
    refused = evaluate(memory, 7)
    assert refused.field == "settings.campaign"
    assert "Campaign 7 does not exist" in refused.problem


def test_a_campaign_that_may_learn_on_is_refused(memory: House) -> None:
    running = memory.create(**CEM)
    memory.store.campaigns.move(running, CampaignState.RUNNING)
    assert "is running and has not ended" in evaluate(memory, running).problem


def test_a_campaign_that_ended_before_it_had_a_state_is_refused(memory: House) -> None:
    cancelled = memory.create(**CEM)
    memory.store.campaigns.move(cancelled, CampaignState.CANCELLED)
    assert "has no checkpoint" in evaluate(memory, cancelled).problem


def test_a_checkpoint_that_another_program_wrote_is_refused(memory: House) -> None:
    trained = memory.run(**CEM, episodes=10)
    memory.store.checkpoints.save(trained, b"no checkpoint")
    assert f"campaign {trained}: The campaign's checkpoint" in evaluate(memory, trained).problem


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"method": "ensemble", "settings": {"method": "monte_carlo", "members": 2}},
    ],
    ids=["alone", "ensemble"],
)
def test_a_campaign_that_learnt_nothing_is_refused(memory: House, fields) -> None:
    plain = memory.run(**fields, episodes=4)
    assert "monte_carlo, which learns nothing" in evaluate(memory, plain).problem


def test_a_warm_start_wants_a_policy(memory: House) -> None:
    trained = memory.run(**CEM, episodes=10)
    for method, settings, field in (
        ("ast", {"warm_start": trained}, "settings.warm_start"),
        ("ensemble", {"settings": {"warm_start": trained}}, "settings.settings.warm_start"),
    ):
        spec = CampaignSpec(name="t", method=method, settings=settings, episodes=30)
        with pytest.raises(InvalidValue, match=r"one of cem and has no policy") as refused:
            references.check_references(resolve_campaign(spec), memory.store)
        assert refused.value.field == field


def test_a_policy_is_trained_on_by_another_campaign_and_that_one_is_evaluated(
    memory: House,
) -> None:
    few = {"round_size": 4, "warm_up": 4, "gradient_steps": 1}
    first = memory.run(method="ast", settings=few, episodes=12)
    second = memory.run(method="ast", settings={**few, "warm_start": first}, episodes=8, seed=1)
    results = memory.results(memory.run(method="evaluate", settings={"campaign": second}))
    assert {result.source for result in results} == {"policy"}


def data(numbers, **fields) -> CampaignSpec:
    settings = {"data_from": numbers}
    return CampaignSpec(name="t", method="difs", settings=settings, episodes=9, **WORLD, **fields)


def experience_of(spec: CampaignSpec, store):
    found = resolve_campaign(spec)
    references.check_references(found, store)
    return references.read_experience(found.references.data, found.form, store)


def test_experience_is_all_that_was_completed(house: House, monkeypatch) -> None:
    monkeypatch.setattr("eigenfail_services.store.episodes.ROWS_AT_A_TIME", 7)
    first, second = house.run(episodes=20, seed=1), house.run(episodes=15, seed=2)
    found = experience_of(data([second, first, second]), house.store)
    results = [*house.results(first), *house.results(second)]
    assert found.z.shape == (35, 100, 2)
    np.testing.assert_array_equal(found.steps, [result.steps for result in results])
    np.testing.assert_allclose(found.robustness_m, [r.measures.robustness_m for r in results])
    for z, result in zip(found.z, results, strict=True):
        np.testing.assert_array_equal(z[: result.steps], result.noise.z)
        assert not z[result.steps :].any()


def test_experience_travels_to_the_learner_as_it_is(memory: House) -> None:
    found = experience_of(data([memory.run(episodes=12)]), memory.store)
    plain = memory.context(memory.create())
    start = Start("m", {}, msgspec.structs.replace(plain, experience=found), 0, None)
    heard = read_learner_command(encode(start)).context
    for name in ("z", "steps", "robustness_m"):
        np.testing.assert_array_equal(getattr(heard.experience, name), getattr(found, name))
    assert plain.experience is None


def test_of_too_many_episodes_the_least_robust_and_an_even_sample_are_kept(
    memory: House, monkeypatch
) -> None:
    monkeypatch.setattr(context_module, "MOST_EPISODES", 10)
    campaign = memory.run(episodes=30)
    found = experience_of(data([campaign]), memory.store)
    robustness = sorted(r.measures.robustness_m for r in memory.results(campaign))
    kept = np.sort(found.robustness_m)
    assert len(kept) == 10
    np.testing.assert_allclose(kept[:5], robustness[:5])
    assert kept[-1] == np.float32(robustness[-1])


def ended(store, channels: int, **fields) -> int:
    """A campaign on noise of so many channels that is done, with one failure."""
    spec = CampaignSpec(name="t", method="monte_carlo", episodes=2, **name_channels(channels))
    made = store.campaigns.create(accept_spec(msgspec.structs.replace(spec, **fields)))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    failure = result_of(channels, 1, outcome=episode.Outcome.COLLISION)
    deliver(store, made, result_of(channels), failure)
    store.campaigns.move(made.id, CampaignState.DONE)
    return made.id


def analysed(store, campaign: int) -> int:
    """An analysis of a campaign that is done."""
    made = store.analyses.create(campaign, AnalysisSettings())
    store.analyses.finish(made.id, analysis_result())
    return made.id


def on_noise(channels: int, method: str, **settings) -> CampaignSpec:
    fields = name_channels(channels)
    return CampaignSpec(name="t", method=method, settings=settings, episodes=9, **fields)


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_learners_are_given_noise_of_all_channels(memory: House, channels: int) -> None:
    before = ended(memory.store, channels)
    for spec, count in (
        (on_noise(channels, "monte_carlo"), 0),
        (on_noise(channels, "replay", campaign=before), 1),
        (on_noise(channels, "replay", campaign=before, episodes=[1, 0]), 2),
    ):
        context = memory.context(memory.store.campaigns.create(accept_spec(spec)).id)
        assert context.trajectories.shape == (count, 3, channels)
        assert context.channels == channels
    experience = experience_of(on_noise(channels, "difs", data_from=[before]), memory.store)
    assert experience.z.shape == (2, 3, channels)
    np.testing.assert_array_equal(experience.z[1], result_of(channels, 1).noise.z)


REFERENCES = [
    ("replay", "campaign", lambda _store, before: before),
    ("replay", "analysis", analysed),
    ("nearest", "analysis", analysed),
    ("difs", "data_from", lambda _store, before: [before]),
    ("ast", "warm_start", lambda _store, before: before),
    ("evaluate", "campaign", lambda _store, before: before),
]


@pytest.mark.parametrize("there", [1, 5])
@pytest.mark.parametrize(("method", "name", "refer"), REFERENCES)
def test_what_other_channels_taught_is_refused(
    memory: House, method: str, name: str, refer, there: int
) -> None:
    before = ended(memory.store, there, method="ast")
    spec = on_noise(3, method, **{name: refer(memory.store, before)})
    words = rf"campaign {before} has another number of channels: {there} there, 3 here"
    with pytest.raises(InvalidValue, match=words) as refused:
        references.check_references(resolve_campaign(spec), memory.store)
    assert refused.value.field == f"settings.{name}"


@pytest.mark.parametrize(
    ("before", "told"),
    [
        ({"method": "gone"}, "method: 'gone' is not known"),
        ({"method": "cem", "settings": {"batch": -1}}, "settings.batch: "),
        ({"method": "cem", "settings": {"gone": 1}}, "settings: 'gone'"),
        ({"method": "ensemble", "settings": {"method": "gone"}}, "'gone' is not known"),
    ],
)
def test_what_is_wrong_with_an_earlier_campaign_is_told_of_the_setting_that_names_it(
    memory: House, before: dict, told: str
) -> None:
    number = ended(memory.store, 3, **before)
    asked = on_noise(3, "evaluate", campaign=number)
    with pytest.raises(InvalidValue, match=f"campaign {number}: .*{told}") as refused:
        references.check_references(resolve_campaign(asked), memory.store)
    assert refused.value.field == "settings.campaign"


def test_an_even_sample_is_even() -> None:
    lived = [references.CompletedEpisode(float(place), 1, place) for place in range(1000)]
    kept = [one.index for one in references.choose_episodes(lived, 20)]
    assert kept[:10] == list(range(10))
    assert kept[10] == 10
    assert kept[-1] == 999
    assert np.ptp(np.diff(kept[10:])) <= 1
    assert references.choose_episodes(lived[:20], 20) == lived[:20]


def test_long_trajectories_are_fewer(memory: House, monkeypatch) -> None:
    monkeypatch.setattr(context_module, "MOST_NUMBERS", 8 * 100 * 2 + 1)
    assert len(experience_of(data([memory.run(episodes=12)]), memory.store).z) == 8


def faulty(index: int):
    task = episode.EpisodeTask(index, episode.episode_seed(0, index), episode.PriorSource())
    result = episode.unrunnable(task, episode.EpisodeFault("planner", "test"))
    return msgspec.structs.replace(result, measures=Measures(0.5))


def test_episodes_that_could_not_be_run_teach_nothing(memory: House) -> None:
    (good,) = memory.results(memory.run(episodes=1))
    mixed, broken = memory.create(episodes=2), memory.create(episodes=1)
    for campaign, results in ((mixed, (good, faulty(1))), (broken, (faulty(0),))):
        memory.store.campaigns.move(campaign, CampaignState.RUNNING)
        memory.store.episodes.commit(campaign, [Delivery(result, "w") for result in results])
        memory.store.campaigns.move(campaign, CampaignState.DONE)
        assert not memory.store.campaigns.get(campaign).counts.open
    assert len(experience_of(data([mixed]), memory.store).z) == 1
    with pytest.raises(InvalidValue, match=f"campaign {broken} has not completed a single"):
        references.check_references(resolve_campaign(data([mixed, broken])), memory.store)


def test_data_of_other_episodes_or_of_too_many_is_refused(memory: House, monkeypatch) -> None:
    campaign = memory.run(episodes=6)
    with pytest.raises(InvalidValue, match="have 100 steps, here they have 200") as refused:
        references.check_references(
            resolve_campaign(data([campaign], scenario="merge_in")), memory.store
        )
    assert refused.value.field == "settings.data_from"
    monkeypatch.setattr(context_module, "MOST_READ", 5)
    with pytest.raises(InvalidValue, match="6 episodes are more than the 5"):
        references.check_references(resolve_campaign(data([campaign])), memory.store)


def test_what_matters_at_birth_alone_is_left_out_of_what_is_handed_on() -> None:
    ast = {"warm_start": 3, "tau": 0.1}
    assert references.leave_out_births("ast", ast) == {"tau": 0.1}
    ensemble = {"method": "ast", "members": 2, "settings": ast}
    assert references.leave_out_births("ensemble", ensemble) == {
        **ensemble,
        "settings": {"tau": 0.1},
    }


def test_what_searches_in_an_ensemble_are_its_members() -> None:
    inner = {"method": "cem", "settings": {"batch": 4}}
    spec = CampaignSpec(name="t", method="ensemble", settings=inner, episodes=9)
    found = resolve_campaign(spec).searching
    assert (found.name, found.settings.batch) == ("cem", 4)
    assert found.field == "settings.settings"


def test_a_claim_reads_what_was_stored_and_loads_no_method(house: House, monkeypatch) -> None:
    replayed = house.run(episodes=3)
    data = house.run(episodes=4, seed=1)
    several = {"method": "difs", "settings": {"data_from": [data]}}
    wanted = (
        {"method": "replay", "settings": {"campaign": replayed, "episodes": [0, 2]}},
        {"method": "minimal", "settings": {"campaign": replayed, "episode": 1}},
        {"method": "ensemble", "settings": {**several, "members": 2}, "episodes": 60},
    )
    made = [house.store.campaigns.create(accept_spec(make_spec(**fields))).id for fields in wanted]

    def refuse(group: str, name: str) -> None:
        raise AssertionError(f"{name} of {group} is loaded")

    monkeypatch.setattr(plugins, "load", refuse)
    replay, minimal, ensemble = map(house.context, made)
    noise = [result.noise.z for result in house.results(replayed)]
    np.testing.assert_array_equal(replay.trajectories[1][: len(noise[2])], noise[2])
    np.testing.assert_array_equal(minimal.trajectories[0][: len(noise[1])], noise[1])
    assert (len(replay.trajectories), len(minimal.trajectories)) == (2, 1)
    assert len(ensemble.experience.steps) == 4


def test_a_learner_without_a_known_length_of_episodes_is_refused(house):
    unknown = house.forget_form(house.create(**CEM))
    with pytest.raises(InvalidValue, match="length of its episodes was not known"):
        references.learner_context(unknown, house.store)
