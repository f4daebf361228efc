"""A campaign whose checkpoints are damaged on the disk: the same episodes, none of them run twice.

Real: the store, the run, the learner and its rounds, the world. Played: the learner's process.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import closing

import pytest
from accepted import accept_spec
from sqlalchemy import update

from eigenfail import plugins
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Delivery, Verdict
from eigenfail.wire.messages import PROTOCOL, Hello, Observed, Start, Stop
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.hub import runs
from eigenfail_services.hub.commits import JudgedResult
from eigenfail_services.hub.learner_process import create_rounds, make_proposal
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.runs import CampaignRun, RunSpec
from eigenfail_services.store.schema import checkpoints
from eigenfail_services.store.store import Store, open_store

WORLD = {"name": "t", "planner": "idm", "simulator": "point_mass", "seed": 5}
CEM = CampaignSpec(**WORLD, method="cem", episodes=50, settings={"batch": 10})
AST = CampaignSpec(
    **WORLD,
    method="ast",
    episodes=30,
    settings={"round_size": 5, "warm_up": 5, "gradient_steps": 1},
)
TURNS = 1_000


class HereLink:
    """A learner in this process."""

    socket = None

    def __init__(self) -> None:
        self.words: deque = deque()
        self.status: int | None = None
        self.rounds: Rounds | None = None
        self.heeding = {Start: self.start, Observed: self.observe, Stop: lambda _: None}

    def send(self, message) -> None:
        self.heeding[type(message)](message)

    def start(self, message: Start) -> None:
        self.rounds = create_rounds(message)
        self.words.append(make_proposal(self.rounds))

    def observe(self, message: Observed) -> None:
        self.rounds.complete(message.results)
        self.words.append(make_proposal(self.rounds))

    def receive(self):
        return self.words.popleft() if self.words else None

    def exit_status(self) -> int | None:
        return self.status

    def stop(self) -> None:
        pass


class Stage:
    """A campaign that is run in this process, whose disk may bend what it keeps."""

    def __init__(self, store: Store, spec: CampaignSpec, links: list[HereLink]) -> None:
        self.store, self.links = store, links
        self.campaign = store.campaigns.create(accept_spec(spec)).id
        running = store.campaigns.move(self.campaign, CampaignState.RUNNING)
        self.engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        self.leases = Leases()
        self.leases.open_session(b"w", Hello(PROTOCOL, "w", 256), 0.0)
        context = learner_context(running, store)
        order = RunSpec(
            self.campaign, spec.setup(), spec.method, spec.settings, spec.seed, context, spec.stop
        )
        self.run = CampaignRun(order, store, self.leases)
        self.leased: list[int] = []

    def turn(self) -> None:
        """Whatever is leased is run and brought at once."""
        self.run.poll()
        for assignment in self.leases.assign():
            if assignment.tasks:
                self.work(assignment.tasks)

    def work(self, tasks) -> None:
        self.leased += [task.index for task in tasks]
        for version in {getattr(task.source, "version", None) for task in tasks} - {None}:
            self.engine.add_policy(self.run.find_policy(version))
        for result in list(self.engine.run(tasks)):
            (verdict,) = self.store.episodes.commit(self.campaign, [Delivery(result, "w")])
            assert verdict is Verdict.KEPT
            self.leases.complete(self.campaign, result.index, 0.1)
            self.run.take_verdicts([JudgedResult(b"w", self.campaign, result, verdict)])

    def turn_until(self, episodes: int) -> None:
        """Until so many episodes are kept, or the campaign is over."""
        for _ in range(TURNS):
            if self.run.end is not None or len(self.leased) >= episodes:
                return
            self.turn()
        raise AssertionError("The campaign does not get on.")

    def bend(self, newest: int) -> None:
        """One bit of each of the newest checkpoints turns over."""
        numbers, mine = checkpoints.c.number, checkpoints.c.campaign == self.campaign
        query = checkpoints.select().where(mine).order_by(numbers.desc()).limit(newest)
        with self.store.database.writing() as connection:
            for row in connection.execute(query).all():
                bent = row.state[:-1] + bytes([row.state[-1] ^ 1])
                change = update(checkpoints).where(mine, numbers == row.number).values(state=bent)
                connection.execute(change)

    def lose_learner(self) -> None:
        """Without another word."""
        self.links[-1].words.clear()
        self.links[-1].status = -9
        self.turn()

    def digest(self) -> str:
        """Of all episodes, at the end."""
        self.turn_until(10_000)
        assert self.run.end is not None
        assert self.run.end.problem == ""
        assert sorted(self.leased) == list(range(len(self.leased)))
        return self.store.campaigns.move(self.campaign, CampaignState.DONE).digest

    def damages(self) -> int:
        events = self.store.events.latest(1_000, self.campaign)
        return sum(event.kind == "checkpoint.damaged" for event in events)


@pytest.fixture
def stage(tmp_path, monkeypatch) -> Iterator:
    links: list[HereLink] = []

    def link(_bounds, _pause_s) -> HereLink:
        links.append(HereLink())
        return links[-1]

    monkeypatch.setattr(runs.learner_link, "LearnerLink", link)
    with closing(open_store(f"sqlite:///{tmp_path / 'a.db'}")) as store:
        yield lambda spec: Stage(store, spec, links)


@pytest.mark.fault(
    "damaged checkpoint",
    group="storage",
    outcome="It is dropped with an event `checkpoint.damaged`, and the campaign continues "
    "from the previous one with the same episodes. If both are damaged, the campaign "
    "ends as dead and names the remedy.",
)
@pytest.mark.parametrize("spec", [CEM, AST], ids=["cem", "ast"])
def test_a_campaign_that_falls_back_has_the_same_episodes(stage, spec) -> None:
    undisturbed = stage(spec)
    wanted = undisturbed.digest()
    assert undisturbed.damages() == 0

    disturbed = stage(spec)
    for episodes in range(10, spec.episodes, 10):
        disturbed.turn_until(episodes)
        disturbed.run.poll()  # what the learner makes of the round is kept, and not yet run
        disturbed.bend(newest=1)
        disturbed.lose_learner()
    assert disturbed.digest() == wanted
    assert disturbed.damages() == len(range(10, spec.episodes, 10))


@pytest.mark.fault("damaged checkpoint")
def test_without_a_checkpoint_that_is_whole_the_campaign_is_over(stage) -> None:
    campaign = stage(CEM)
    campaign.turn_until(30)
    campaign.bend(newest=2)
    campaign.lose_learner()
    campaign.turn()
    assert "SHA-256 does not match" in campaign.run.end.problem
    assert "Launch the campaign again" in campaign.run.end.problem
    assert campaign.damages() == 0
