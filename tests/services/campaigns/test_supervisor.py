"""The supervisor on a real store, with a hub and analyses that the test plays."""

from queue import SimpleQueue

import pytest
from accepted import accept_spec

from eigenfail.errors import NotFound, StoreUnavailable
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, Priority, StopRules
from eigenfail.values.episode import EpisodeFault, EpisodeTask, PriorSource, unrunnable
from eigenfail.values.records import Delivery, JobKind
from eigenfail_services.campaigns import supervisor as module
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub.metrics import CampaignPhase
from eigenfail_services.hub.server import FinishedRun
from eigenfail_services.store.store import open_store

ROOM = module.ROOM[JobKind.CAMPAIGN]


class Hub:
    def __init__(self) -> None:
        self.finished_runs: SimpleQueue[FinishedRun] = SimpleQueue()
        self.launched: list[int] = []
        self.halted: list[int] = []
        self.weights: list[tuple[int, float]] = []

    def launch(self, order) -> None:
        self.launched.append(order.campaign)
        self.set_weight(order.campaign, order.weight)

    def set_weight(self, campaign: int, weight: float) -> None:
        self.weights.append((campaign, weight))

    def halt(self, campaign: int) -> None:
        self.halted.append(campaign)


class Analyses:
    def __init__(self) -> None:
        self.opened = []

    def __len__(self) -> int:
        return len(self.opened)

    def open(self, job) -> None:
        self.opened.append(job)

    def poll(self) -> None:
        pass


class House:
    def __init__(self) -> None:
        self.store = open_store("memory://")
        self.hub = Hub()
        self.analyses = Analyses()
        self.supervisor = self.another_supervisor()

    def another_supervisor(self, **more) -> Supervisor:
        return Supervisor(self.store, self.hub, self.analyses, **more)  # type: ignore[arg-type]

    def create(self, **fields) -> int:
        spec = CampaignSpec(**{"name": "t", "method": "monte_carlo", "episodes": 5} | fields)
        return self.store.campaigns.create(accept_spec(spec)).id

    def state(self, campaign: int) -> CampaignState:
        return self.store.campaigns.get(campaign).state

    def end(self, campaign: int, problem: str = "", because: str = "", declined: str = "") -> None:
        """The hub has ended a campaign, and the supervisor hears of it."""
        self.hub.finished_runs.put(FinishedRun(campaign, problem, because, declined=declined))
        self.supervisor.turn()


def away(*_) -> None:
    raise StoreUnavailable("The disk is full.")


@pytest.fixture
def house() -> House:
    return House()


def test_what_waits_but_cannot_be_claimed_holds_nothing_up(house: House, monkeypatch) -> None:
    campaign = house.create()
    with monkeypatch.context() as locked:
        locked.setattr(house.store.jobs, "claim", lambda *_: None)
        house.supervisor.turn()
    assert house.hub.launched == []
    house.supervisor.turn()
    assert house.hub.launched == [campaign]


def test_a_queued_campaign_is_launched_once(house: House) -> None:
    campaign = house.create()
    for _ in range(3):
        house.supervisor.turn()
    assert house.hub.launched == [campaign]
    assert house.state(campaign) is CampaignState.RUNNING


def test_what_the_hub_has_ended_is_done_and_its_job_gone(house: House) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.end(campaign, because="The budget of 5 episodes was spent.")
    ended = house.store.campaigns.get(campaign)
    assert ended.state is CampaignState.DONE
    assert ended.stopped_because == "The budget of 5 episodes was spent."
    assert house.store.jobs.claim("other", 10.0, JobKind.CAMPAIGN) is None


def test_trouble_in_the_hub_is_the_reason_that_the_campaign_keeps(house: House) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.end(campaign, "The learner diverged.")
    ended = house.store.campaigns.get(campaign)
    assert (ended.state, ended.stopped_because) == (CampaignState.DEAD, "The learner diverged.")


@pytest.mark.parametrize(
    ("wish", "rest"),
    [
        (CampaignState.PAUSING, CampaignState.PAUSED),
        (CampaignState.CANCELLING, CampaignState.CANCELLED),
    ],
)
def test_a_wish_halts_the_hub_once_and_comes_true(house: House, wish, rest) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.store.campaigns.move(campaign, wish)
    house.supervisor.turn()
    house.supervisor.turn()
    assert house.hub.halted == [campaign]
    house.end(campaign)
    rests = house.store.campaigns.get(campaign)
    assert rests.state is rest
    assert (rests.stopped_because == "") == (rest is CampaignState.PAUSED)


def test_a_campaign_that_cannot_be_staged_dies_with_the_reason(house: House) -> None:
    campaign = house.create(method="replay", settings={"analysis": 999})
    house.supervisor.turn()
    ended = house.store.campaigns.get(campaign)
    assert ended.state is CampaignState.DEAD
    assert "999" in ended.stopped_because


def test_analyses_do_not_wait_for_campaigns(house: House) -> None:
    campaigns = [house.create() for _ in range(ROOM + 1)]
    analysis = house.store.analyses.create(campaigns[0], AnalysisSettings())
    house.supervisor.turn()
    assert house.hub.launched == campaigns[:ROOM]
    assert [job.subject for job in house.analyses.opened] == [analysis.id]


def test_what_is_released_is_taken_up_by_the_next_supervisor(house: House) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.supervisor.release()
    house.another_supervisor().turn()
    assert house.hub.launched == [campaign, campaign]
    assert house.state(campaign) is CampaignState.RUNNING


def test_progress_is_told_when_there_is_some(house: House, monkeypatch) -> None:
    campaign = house.create()
    monkeypatch.setattr(module, "RENEW_S", 0.0)

    def told() -> list[str]:
        events = house.store.events.after(0, 100, campaign)
        return [event.message for event in events if event.kind == "campaign.progress"]

    for _ in range(3):
        house.supervisor.turn()
    assert told() == ["0 of 5 episodes, 0 failures."]
    result = unrunnable(EpisodeTask(0, 0, PriorSource()), EpisodeFault("input", "test"))
    house.store.episodes.commit(campaign, [Delivery(result, "w")])
    house.supervisor.turn()
    assert told()[1:] == ["1 of 5 episodes, 0 failures."]


def test_an_ending_that_the_store_refuses_is_kept_for_later(house: House, monkeypatch) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.hub.finished_runs.put(FinishedRun(campaign, ""))
    move = house.store.campaigns.move

    monkeypatch.setattr(house.store.campaigns, "move", away)
    with pytest.raises(StoreUnavailable):
        house.supervisor.turn()
    monkeypatch.setattr(house.store.campaigns, "move", move)
    house.supervisor.turn()
    assert house.state(campaign) is CampaignState.DONE


def test_our_own_lease_that_ran_out_launches_nothing_twice(house: House, monkeypatch) -> None:
    campaign = house.create()
    claim, claimed = house.store.jobs.claim, []
    monkeypatch.setattr(
        house.store.jobs, "claim", lambda *asked: claimed.append(claim(*asked)) or claimed[-1]
    )
    house.supervisor.turn()
    house.store.jobs.renew(claimed[0], -1.0)
    house.supervisor.turn()
    assert [job.subject for job in claimed] == [campaign, campaign]
    assert house.hub.launched == [campaign]
    house.end(campaign)
    assert house.state(campaign) is CampaignState.DONE


def test_who_was_resumed_as_it_was_claimed_is_launched_once(house: House, monkeypatch) -> None:
    campaign = house.create()
    claim, claimed = house.store.jobs.claim, []

    def disturbed(*asked):
        claimed.append(claim(*asked))
        if len(claimed) == 1:
            house.store.campaigns.move(campaign, CampaignState.PAUSED)
            house.store.campaigns.move(campaign, CampaignState.QUEUED)
        return claimed[-1]

    monkeypatch.setattr(house.store.jobs, "claim", disturbed)
    house.supervisor.turn()
    assert [job.subject for job in claimed] == [campaign, campaign]
    assert house.hub.launched == [campaign]
    assert house.state(campaign) is CampaignState.RUNNING


def test_who_lost_a_campaign_while_it_was_staged_does_not_end_it(house: House, monkeypatch) -> None:
    campaign = house.create()
    claim, claimed = house.store.jobs.claim, []
    monkeypatch.setattr(
        house.store.jobs, "claim", lambda *asked: claimed.append(claim(*asked)) or claimed[-1]
    )

    def lost_meanwhile(*_):
        house.store.jobs.renew(claimed[0], 0.0)
        assert claim("another", 60.0, JobKind.CAMPAIGN)
        raise NotFound("There is no analysis 999.")

    monkeypatch.setattr(module, "learner_context", lost_meanwhile)
    house.supervisor.turn()
    assert house.hub.launched == []
    assert house.state(campaign) is CampaignState.RUNNING


def test_a_cancellation_in_the_very_moment_of_a_pause_is_heeded(house: House, monkeypatch) -> None:
    campaign = house.create()
    house.supervisor.turn()
    house.store.campaigns.move(campaign, CampaignState.PAUSING)
    house.supervisor.turn()
    seen = house.store.campaigns.get(campaign)
    house.store.campaigns.move(campaign, CampaignState.CANCELLING)
    house.hub.finished_runs.put(FinishedRun(campaign, ""))
    with monkeypatch.context() as patch:
        patch.setattr(house.store.campaigns, "get", lambda _: seen)
        house.supervisor.turn()
    house.supervisor.turn()
    assert house.state(campaign) is CampaignState.CANCELLED


def test_what_the_time_went_into_is_billed_with_it(house: House, monkeypatch) -> None:
    orders = []
    monkeypatch.setattr(house.hub, "launch", orders.append)
    campaign = house.create()
    house.supervisor.turn()
    accounting = orders[0].accounting
    accounting.add_discarded(0.5)
    accounting.set_phase(CampaignPhase.LEARNING)

    with monkeypatch.context() as patch:
        patch.setattr(house.store.campaigns, "add_active", away)
        with pytest.raises(StoreUnavailable):
            house.supervisor.release()
    house.supervisor.release()
    billed = house.store.campaigns.get(campaign)
    assert 0.0 < billed.overhead.learning_s <= billed.active_s
    assert (billed.overhead.waiting_s, billed.overhead.discarded_s) == (0.0, 0.5)


class Clock:
    """Time as a test wants it."""

    def __init__(self, monkeypatch) -> None:
        self.now_s = 0.0
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now_s)

    def turn(self, house: House, until_s: float) -> None:
        self.now_s = until_s
        house.supervisor.turn()


def test_the_rules_on_results_go_to_the_hub(house: House, monkeypatch) -> None:
    orders = []
    monkeypatch.setattr(house.hub, "launch", orders.append)
    house.create(stop=StopRules(failures=3))
    house.supervisor.turn()
    assert [order.rules for order in orders] == [StopRules(failures=3)]


@pytest.mark.parametrize(
    ("rules", "because"),
    [
        (StopRules(wall_s=60.0), "It ran for 60 s (rule: wall_s = 60.0)."),
        # Two instances at 1.80 USD/h for a minute.
        (StopRules(cost_usd=0.06), "It cost 0.06 USD (rule: cost_usd = 0.06)."),
    ],
)
def test_a_rule_on_time_or_cost_halts_the_campaign_once_and_it_is_done(
    house: House, monkeypatch, rules, because
) -> None:
    clock = Clock(monkeypatch)
    campaign = house.create(stop=rules, price_usd_per_hour=1.8, instances=2)
    clock.turn(house, 0.0)
    clock.turn(house, 59.0)
    assert house.hub.halted == []
    for now_s in (60.0, 61.0):
        clock.turn(house, now_s)
    assert house.hub.halted == [campaign]
    house.hub.finished_runs.put(FinishedRun(campaign, ""))
    clock.turn(house, 62.0)
    ended = house.store.campaigns.get(campaign)
    assert (ended.state, ended.stopped_because) == (CampaignState.DONE, because)
    assert (ended.counts.cancelled, ended.counts.open) == (5, 0)


def test_pauses_do_not_count_and_a_restart_forgets_nothing(house: House, monkeypatch) -> None:
    clock = Clock(monkeypatch)
    campaign = house.create(stop=StopRules(wall_s=60.0))
    clock.turn(house, 0.0)
    clock.turn(house, 40.0)
    house.store.campaigns.move(campaign, CampaignState.PAUSING)
    clock.turn(house, 40.0)
    house.hub.finished_runs.put(FinishedRun(campaign, ""))
    clock.turn(house, 40.0)
    assert house.state(campaign) is CampaignState.PAUSED
    house.supervisor = house.another_supervisor()
    house.store.campaigns.move(campaign, CampaignState.QUEUED)
    clock.turn(house, 1000.0)
    clock.turn(house, 1019.0)
    assert house.hub.halted == [campaign]  # for the pause
    clock.turn(house, 1020.0)
    assert house.hub.halted == [campaign, campaign]


def test_a_user_who_asks_first_is_heeded_although_time_runs_out(house: House, monkeypatch) -> None:
    clock = Clock(monkeypatch)
    campaign = house.create(stop=StopRules(wall_s=60.0))
    clock.turn(house, 0.0)
    house.store.campaigns.move(campaign, CampaignState.CANCELLING)
    clock.turn(house, 30.0)
    clock.turn(house, 90.0)
    house.hub.finished_runs.put(FinishedRun(campaign, ""))
    clock.turn(house, 90.0)
    assert house.state(campaign) is CampaignState.CANCELLED


def test_as_many_run_at_a_time_as_it_is_told(house: House) -> None:
    campaigns = [house.create() for _ in range(3)]
    supervisor = house.another_supervisor(campaigns=1)
    for campaign in campaigns:
        supervisor.turn()
        assert house.hub.launched[-1] == campaign
        house.hub.finished_runs.put(FinishedRun(campaign, ""))
        supervisor.turn()
    assert house.hub.launched == campaigns


def test_the_urgent_ones_run_first(house: House) -> None:
    wanted = [house.create(priority=priority) for priority in reversed(Priority)]
    last = house.create(priority=Priority.LOW)
    first = house.create(priority=Priority.HIGH)
    house.another_supervisor(campaigns=5).turn()
    high, normal, low = wanted
    assert house.hub.launched == [high, first, normal, low, last]


def test_a_new_priority_is_a_new_weight_once(house: House) -> None:
    campaign = house.create(priority=Priority.LOW)
    house.supervisor.turn()
    house.store.campaigns.prioritise(campaign, Priority.HIGH)
    for _ in range(3):
        house.supervisor.turn()
    assert house.hub.weights == [(campaign, 1), (campaign, 9)]


@pytest.mark.fault(
    "campaign resumed by another release",
    group="processes",
    outcome="An event, the page, the report, the command and comparisons say after how many "
    "results which versions changed.",
)
def test_a_campaign_that_another_release_goes_on_with_says_so(house: House, monkeypatch) -> None:
    campaign = house.create()
    house.supervisor.turn()
    result = unrunnable(EpisodeTask(0, 0, PriorSource()), EpisodeFault("input", "test"))
    house.store.episodes.commit(campaign, [Delivery(result, "w")])
    house.supervisor.release()
    same = house.another_supervisor()
    same.turn()
    assert not house.store.campaigns.get(campaign).is_mixed
    same.release()
    then = module.learner_versions()
    monkeypatch.setattr(module, "learner_versions", lambda: then | {"eigenfail": "9.9.9"})
    house.another_supervisor().turn()
    mixed = house.store.campaigns.get(campaign)
    assert [part.versions["eigenfail"] for part in mixed.parts] == [then["eigenfail"], "9.9.9"]
    (event,) = (
        each for each in house.store.events.after(0, 100) if each.kind == "campaign.mixed_releases"
    )
    assert f"after 1 result: eigenfail {then['eigenfail']} then, 9.9.9 now." in event.message


@pytest.mark.fault("campaign with a name that the bridge does not know")
@pytest.mark.parametrize(
    ("wish", "after"),
    [(None, CampaignState.PAUSED), (CampaignState.CANCELLING, CampaignState.CANCELLED)],
)
def test_a_campaign_that_a_worker_declined_is_paused_with_the_reason(
    house: House, wish, after
) -> None:
    campaign = house.create()
    house.supervisor.turn()
    if wish:
        house.store.campaigns.move(campaign, wish)
    house.end(campaign, declined="Worker w can run no episode.")
    rests = house.store.campaigns.get(campaign)
    assert rests.state is after
    assert rests.stopped_because.startswith("Worker w can run no episode. Launch a corrected one")
    assert house.store.jobs.claim("other", 10.0, JobKind.CAMPAIGN) is None
    if after is CampaignState.PAUSED:
        house.store.campaigns.move(campaign, CampaignState.QUEUED)
        assert house.store.campaigns.get(campaign).stopped_because == ""
        house.supervisor.turn()
        assert house.hub.launched == [campaign, campaign]


FUNCTION = {"simulator": "function", "scenario": "function", "planner": "unlisted_module:f"}
STEPS = {"scenario_parameters": {"steps": 2}}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((), CampaignState.PAUSED),
        ((CampaignState.RUNNING,), CampaignState.PAUSED),
        ((CampaignState.RUNNING, CampaignState.PAUSING), CampaignState.PAUSED),
        ((CampaignState.RUNNING, CampaignState.CANCELLING), CampaignState.CANCELLED),
    ],
)
def test_a_function_that_is_not_listed_any_more_rests_and_can_go_on(
    house: House, monkeypatch, before, after
) -> None:
    campaign = house.create(**FUNCTION, **STEPS)
    for state in before:
        house.store.campaigns.move(campaign, state)
    house.supervisor.turn()
    assert (house.state(campaign), house.hub.launched) == (after, [])
    assert house.store.jobs.claim("other", 10.0, JobKind.CAMPAIGN) is None
    told = " ".join(event.message for event in house.store.events.after(0, 100))
    assert "eigenfail up --functions unlisted_module" in told
    assert f"eigenfail campaign resume {campaign}." in told
    if after is CampaignState.PAUSED:
        monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "unlisted_module")
        house.store.campaigns.move(campaign, CampaignState.QUEUED)
        house.supervisor.turn()
        assert house.hub.launched == [campaign]
