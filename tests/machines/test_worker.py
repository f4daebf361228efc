"""A worker between its hub and its child, in any order of events: what it is leased, it brings.

Real: the parent, the bookkeeping around its child, and the child's own. Played: the hub, the
simulator, the socket and pipes between them, and the clock.
"""

from contextlib import ExitStack
from types import SimpleNamespace
from unittest.mock import patch

from benchmarks.faults.fake_services import LAYER, quiet
from benchmarks.faults.fake_worker import FakeEngine, FakeWorker
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test
from lives import lives
from msgspec.structs import replace

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Outcome, PolicySource, PriorSource
from eigenfail.values.learning import Policy
from eigenfail.wire.messages import (
    FINISHED,
    PROTOCOL,
    Ack,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    Lease,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
    encode,
    fingerprint_task,
    read_worker_message,
)
from eigenfail_workers.worker import child_process, parent

BUILT_IN = CampaignSpec(name="t", method="monte_carlo", episodes=9)
SETUPS = {
    campaign: replace(BUILT_IN, planner=planner).setup()
    for campaign, planner in {1: "rulebook", 2: "test_raises", 3: "test_dies"}.items()
}
"""Of the campaigns; those with a plug-in have an inner process each."""

TURNS_TO_THE_END = 120

Key = tuple[int, int]
campaigns = st.integers(1, 3)
indices = st.lists(st.integers(0, 30), min_size=1, max_size=6, unique=True)


def task(index: int) -> EpisodeTask:
    """Every third one needs the policy of its campaign."""
    return EpisodeTask(index, 1_000 + index, PriorSource() if index % 3 else PolicySource(4))


def policy() -> Policy:
    return Policy(4, (), LAYER, LAYER, 3.0, 1)


class Worker(RuleBasedStateMachine):
    """The hub knows what it leased, and what came back."""

    def __init__(self) -> None:
        super().__init__()
        self.stack = ExitStack()
        self.now_s = [1_000.0]
        clock = SimpleNamespace(monotonic=lambda: self.now_s[0])
        for module in (parent, child_process):
            self.stack.enter_context(patch.object(module, "time", clock))
        self.stack.enter_context(quiet())
        self.worker = FakeWorker()
        self.leased: set[Key] = set()
        self.owed: set[Key] = set()
        self.brought: set[Key] = set()
        self.acknowledged: set[Key] = set()
        self.turn()

    def say(self, *messages) -> None:
        self.worker.dealer.inbox.extend(map(encode, messages))
        self.turn()

    def turn(self) -> None:
        self.worker.turn()
        while self.worker.dealer.outbox:
            said = read_worker_message(self.worker.dealer.outbox.popleft())
            HEEDING[type(said)](self, said)

    def hear_beat(self, said: Heartbeat) -> None:
        """It names what it has and is still owed, and runs one of these or one that was dropped."""
        named = set(said.held)
        assert len(named) == len(said.held)
        assert named <= self.leased
        assert self.owed - self.brought - self.acknowledged <= named
        if said.running is not None:
            assert (said.campaign, said.running) in self.leased

    def hear_hello(self, said: Hello) -> None:
        """It claims the same, as the very tasks that they are, and what it keeps of results."""
        claims = {(each.campaign, each.index): each.task for each in said.holdings}
        assert len(claims) == len(said.holdings)
        kept = {key for key, told in claims.items() if told == FINISHED}
        assert kept == self.brought - self.acknowledged
        for (campaign, index), told in claims.items():
            assert told in {FINISHED, fingerprint_task(SETUPS[campaign], task(index))}
            assert (campaign, index) in self.leased
        assert self.owed - self.acknowledged <= set(claims)

    def hear(self, said: Results) -> None:
        for brought in said.results:
            key = (said.campaign, brought.index)
            assert key in self.leased
            if brought.outcome is not Outcome.ERRORED:
                expected = ENGINE.result(task(brought.index))
                assert (brought.digest(), brought.seed) == (expected.digest(), expected.seed)
            self.brought.add(key)

    def prepare(self, campaign: int) -> None:
        self.say(Setup(campaign, SETUPS[campaign]), PolicyUpdate(campaign, policy()))

    def lend(self, campaign: int, numbers) -> None:
        wanted = [i for i in numbers if (campaign, i) not in self.acknowledged]
        self.leased |= {(campaign, index) for index in wanted}
        self.say(Lease(campaign, tuple(map(task, wanted))))

    @rule()
    def welcome(self) -> None:
        self.say(Welcome(1.0))

    @rule()
    def refuse(self) -> None:
        self.say(Refusal("say hello"))

    @rule(campaign=campaigns)
    def set_up(self, campaign) -> None:
        self.prepare(campaign)

    @rule(campaign=campaigns, numbers=indices)
    def lease(self, campaign, numbers) -> None:
        self.prepare(campaign)
        self.lend(campaign, numbers)
        self.owed |= {(campaign, index) for index in numbers}

    @rule(campaign=campaigns, numbers=indices)
    def lease_while_the_setup_went_astray(self, campaign, numbers) -> None:
        self.lend(campaign, numbers)

    @rule(campaign=campaigns, numbers=indices)
    def lease_while_the_policy_went_astray(self, campaign, numbers) -> None:
        self.say(Setup(campaign, SETUPS[campaign]))
        self.lend(campaign, numbers)

    @rule(numbers=st.lists(st.integers(0, 90), max_size=5))
    def acknowledge(self, numbers) -> None:
        brought = sorted(self.brought)
        for key in {brought[number % len(brought)] for number in numbers if brought}:
            self.acknowledged.add(key)
            self.say(Ack(key[0], (key[1],)))

    @rule(campaign=campaigns)
    def acknowledge_what_never_came(self, campaign) -> None:
        self.say(Ack(campaign, (500, -1)))

    @rule(campaign=campaigns)
    def drop(self, campaign) -> None:
        self.say(Drop(campaign))
        self.owed = {key for key in self.owed if key[0] != campaign}

    @rule(data=st.sampled_from([b"", b"\xc1", encode(Hello(PROTOCOL, "w", 1)), b"\x91" * 5_000]))
    def talk_nonsense(self, data) -> None:
        self.worker.dealer.inbox.append(data)
        self.turn()

    @rule(messages=st.integers(1, 6))
    def work(self, messages) -> None:
        self.worker.child.work(messages)
        self.turn()

    @rule()
    def lose_the_child(self) -> None:
        self.worker.child.alive = False
        self.turn()

    @rule(seconds=st.sampled_from([0.1, 1.5, 30.0]))
    def wait(self, seconds) -> None:
        self.now_s[0] += seconds
        self.turn()

    @rule()
    def hang(self) -> None:
        """The child does nothing for minutes, while the parent looks at it all the time."""
        for _ in range(130):
            self.now_s[0] += 1.0
            self.turn()

    def teardown(self) -> None:
        """All that it has taken comes; then a hub that is well leases the rest, and gets it."""
        with self.stack:
            self.end_well()

    def end_well(self) -> None:
        self.run_all()
        assert self.brought >= self.owed
        self.say(Welcome(1.0))
        missing = self.leased - self.acknowledged
        for campaign in {key[0] for key in missing}:
            self.prepare(campaign)
            self.lend(campaign, [index for of, index in sorted(missing) if of == campaign])
        self.brought.clear()
        self.say(Refusal("who are you?"), Welcome(1.0))
        self.run_all()
        assert self.brought >= missing
        self.acknowledged |= self.leased
        self.say(*(Ack(campaign, (index,)) for campaign, index in self.leased))
        self.brought.clear()
        self.say(Refusal("who are you?"), Welcome(1.0))
        assert not self.brought
        self.worker.dealer.inbox.append(encode(Goodbye()))

    def run_all(self) -> None:
        for _ in range(TURNS_TO_THE_END):
            self.worker.child.work(10)
            self.turn()


ENGINE = FakeEngine(SETUPS[1])
HEEDING = {Hello: Worker.hear_hello, Heartbeat: Worker.hear_beat, Results: Worker.hear}


def test_lives_of_a_worker() -> None:
    run_state_machine_as_test(Worker, settings=lives(80, 40))
