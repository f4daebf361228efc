"""Users, supervisors, a hub and workers in any order of events: no episode is lost, none doubled.

Real: the store, the supervisor, the hub and all that it is made of. Played: learners, workers, the
socket between, and the clock.
"""

import shutil
import tempfile
from contextlib import ExitStack, closing
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from accepted import accept_spec
from benchmarks.faults.fake_services import fake_learners, quiet
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from lives import lives
from service_house import EPISODES, Away, House
from service_workers import FakeWorker

from eigenfail.errors import IllegalTransition
from eigenfail.testing.examples import result
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire.messages import Goodbye, Results
from eigenfail_api.routes.campaigns import CANCEL, PAUSE, RESUME, steer
from eigenfail_services.campaigns import supervisor
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.worker_sessions import SILENCE_LIMIT_S
from eigenfail_services.store.store import open_store

numbers = st.integers(0, 50)


class Service(RuleBasedStateMachine):
    """Anything may happen at any time."""

    def __init__(self, opened) -> None:
        super().__init__()
        self.stack = ExitStack()
        now_s = [1_000.0]
        clock = SimpleNamespace(monotonic=lambda: now_s[0])
        for module in (worker_sessions, commits, supervisor):
            self.stack.enter_context(patch.object(module, "time", clock))
        self.stack.enter_context(quiet())
        learners = self.stack.enter_context(fake_learners())
        self.house = House(Away(self.stack.enter_context(opened())), learners, now_s)

    def worker(self, number: int) -> FakeWorker:
        return self.house.workers[number % len(self.house.workers)]

    def campaign(self, number: int) -> int:
        return self.house.campaigns[number % len(self.house.campaigns)]

    crewed = precondition(lambda self: self.house.workers)
    busy = precondition(lambda self: self.house.campaigns)

    @precondition(lambda self: len(self.house.campaigns) < 3)
    @rule()
    def create(self) -> None:
        spec = CampaignSpec(name="t", method="monte_carlo", episodes=EPISODES)
        self.house.campaigns.append(self.house.store.campaigns.create(accept_spec(spec)).id)
        self.house.turn()

    @busy
    @rule(number=numbers, wish=st.sampled_from([PAUSE, RESUME, CANCEL]), turns=st.integers(0, 2))
    def steer(self, number, wish, turns) -> None:
        campaign = self.campaign(number)
        state = self.house.store.campaigns.get(campaign).state
        if state in wish.done_in or state in wish.steps:
            steer(self.house.store, campaign, wish)
        else:
            with pytest.raises(IllegalTransition, match=f"Campaign {campaign} .*{state}"):
                steer(self.house.store, campaign, wish)
        for _ in range(turns):
            self.house.turn()

    @precondition(lambda self: len(self.house.workers) < 4)
    @rule(name=st.sampled_from(["one", "one", "two"]))
    def join(self, name) -> None:
        worker = FakeWorker(f"c{next(self.house.names)}".encode(), name)
        self.house.workers.append(worker)
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers, n=st.integers(1, 4))
    def work(self, number, n) -> None:
        for _ in range(n):
            self.house.run_one(self.worker(number))
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def bring_again(self, number) -> None:
        self.worker(number).bring_again()
        self.house.turn()

    @busy
    @crewed
    @rule(number=numbers, index=st.integers(-1, EPISODES), salt=st.integers(0, 1))
    def bring_unasked(self, number, index, salt) -> None:
        """Before it was leased, after it was finished, of a campaign that is over."""
        campaign, worker = self.campaign(number), self.worker(number)
        done = result(index, salt=salt, seed=abs(index))
        self.house.say(worker, Results(campaign, (done,)), Results(999, (done,)))
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def fall_silent(self, number) -> None:
        self.worker(number).heard = False

    @crewed
    @rule(number=numbers)
    def be_heard_again(self, number) -> None:
        worker = self.worker(number)
        worker.heard = True
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def miss_words(self, number) -> None:
        self.house.miss_words(self.worker(number))

    @crewed
    @rule(number=numbers)
    def hello_again(self, number) -> None:
        worker = self.worker(number)
        worker.welcome = False
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers, word=st.booleans())
    def die(self, number, word) -> None:
        worker = self.worker(number)
        if word:
            self.house.say(worker, Goodbye())
        self.house.workers.remove(worker)
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def come_by_another_connection(self, number) -> None:
        """The network was away: the same process, with all that it holds."""
        worker = self.worker(number)
        worker.connection = f"c{next(self.house.names)}".encode()
        self.house.say(worker, worker.beat())
        self.house.turn()

    @rule(seconds=st.sampled_from([1, 3, int(SILENCE_LIMIT_S) + 2]))
    def wait(self, seconds) -> None:
        self.house.seconds(seconds)

    @rule(seconds=st.sampled_from([20, 3600]))
    def stand_still(self, seconds) -> None:
        self.house.turn(float(seconds))

    @rule(number=numbers)
    def lose_a_learner(self, number) -> None:
        if self.house.learners:
            self.house.learners[-1 - number % len(self.house.learners)].status = -9
        self.house.turn()

    @rule()
    def lose_the_store(self) -> None:
        self.house.store.away = not self.house.store.away
        self.house.turn(2.0)

    @rule()
    def begin_anew(self) -> None:
        """The service stops and starts again; workers find out by themselves."""
        self.house.close()
        self.house.open()
        self.house.turn()

    @rule()
    def be_killed(self) -> None:
        """The service is, and starts again while its workers go on with what they hold."""
        self.house.be_killed()

    @invariant()
    def accounted(self) -> None:
        self.house.account()
        self.house.nobody_shares()

    def teardown(self) -> None:
        with self.stack:
            self.house.end_well()


def run(opened, examples: int) -> None:
    """Let the machine live many lives."""
    run_state_machine_as_test(
        lambda: Service(opened),
        settings=lives(examples, 40),
    )


@pytest.mark.fault("SIGKILL of a worker")
@pytest.mark.fault("SIGKILL of the services")
@pytest.mark.fault("SIGSTOP of a worker")
@pytest.mark.fault("result that arrives twice, late, unasked or for another campaign")
@pytest.mark.fault("worker connection cut")
@pytest.mark.fault("two workers with one name")
@pytest.mark.fault("immediate shutdown of PostgreSQL")
def test_lives_in_memory() -> None:
    run(lambda: closing(open_store("memory://")), 80)


@pytest.mark.fault("SIGKILL of a worker")
@pytest.mark.fault("SIGKILL of the services")
@pytest.mark.fault("SIGSTOP of a worker")
@pytest.mark.fault("result that arrives twice, late, unasked or for another campaign")
@pytest.mark.fault("worker connection cut")
@pytest.mark.fault("two workers with one name")
@pytest.mark.fault("immediate shutdown of PostgreSQL")
def test_lives_in_sqlite(sqlite_template: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        numbers = count()

        def opened():
            path = Path(folder) / f"{next(numbers)}.db"
            shutil.copy(sqlite_template, path)
            return closing(open_store(f"sqlite:///{path}"))

        run(opened, 8)
