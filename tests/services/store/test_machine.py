"""Any order of deliveries, moves, claims and lost leases, against a model that fits on a page."""

import hashlib
import shutil
import tempfile
from pathlib import Path

import pytest
from accepted import accept_spec
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from lives import lives
from store_checks.examples import deliver

from eigenfail.errors import IllegalTransition
from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import FINAL_STATES, CampaignState, Counts
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Verdict
from eigenfail_services.store.lifecycle import MOVES, REPEATABLE
from eigenfail_services.store.store import open_store

PLANNED = 5
LONG_S = 60.0
MAX_ATTEMPTS = 5
S = CampaignState

WISHES = (
    {S.QUEUED: S.RUNNING},
    {S.QUEUED: S.PAUSED, S.RUNNING: S.PAUSING, S.PAUSING: S.PAUSED},
    {S.PAUSED: S.QUEUED, S.PAUSING: S.RUNNING},
)

MAKERS = {
    "safe": result,
    "other": lambda index: result(index, salt=1),
    "crash": collision,
    "failed": make_errored_result,
}
deliveries = st.lists(st.tuples(st.integers(-1, PLANNED), st.sampled_from(sorted(MAKERS))))


class Life(RuleBasedStateMachine):
    """One campaign, what is delivered to it, and its job."""

    def __init__(self, opened) -> None:
        super().__init__()
        self.store = opened()
        self.be_born()

    def be_born(self) -> None:
        self.campaign = self.store.campaigns.create(accept_spec(spec(episodes=PLANNED)))
        self.state = S.QUEUED
        self.results = {}
        self.again = 0
        self.cancelled = 0
        self.digest = None
        self.queued, self.leased, self.attempts, self.progress = True, False, 0, 0
        self.job, self.lost = None, []

    def teardown(self) -> None:
        self.store.close()

    def expected_verdict(self, each) -> Verdict:
        if self.state in FINAL_STATES or not 0 <= each.index < PLANNED:
            return Verdict.UNWANTED
        kept = self.results.setdefault(each.index, each)
        if kept is each:
            return Verdict.KEPT
        self.again += 1
        return Verdict.DUPLICATE if kept.digest() == each.digest() else Verdict.ALARM

    @rule(wanted=deliveries)
    def deliver(self, wanted) -> None:
        results = [MAKERS[kind](index) for index, kind in wanted]
        expected = [self.expected_verdict(each) for each in results]
        assert deliver(self.store, self.campaign, *results) == expected

    @precondition(lambda self: self.state in FINAL_STATES)
    @rule()
    def be_born_again(self) -> None:
        while job := self.store.jobs.claim("somebody", LONG_S):
            assert self.store.jobs.finish(job)
        if self.job:
            self.store.jobs.finish(self.job)
        self.be_born()

    @rule(wish=st.sampled_from(WISHES))
    def wish(self, wish) -> None:
        if self.state in wish:
            self.move(wish[self.state])

    @rule(to=st.sampled_from(S))
    def move_anywhere(self, to) -> None:
        self.move(to)

    def move(self, to) -> None:
        if to not in MOVES[self.state] and not (to is self.state and to in REPEATABLE):
            with pytest.raises(IllegalTransition):
                self.store.campaigns.move(self.campaign.id, to)
            return
        self.store.campaigns.move(self.campaign.id, to)
        if to is not self.state:
            self.moved(to)

    def moved(self, to) -> None:
        if to is S.QUEUED:
            self.lose_job()
            self.queued, self.leased, self.attempts, self.progress = True, False, 0, 0
        if self.state is S.QUEUED and to in {S.PAUSED, S.CANCELLED}:
            self.lose_job()
            self.queued = False
        self.state = to
        if to in FINAL_STATES:
            self.cancelled = PLANNED - len(self.results)
        if to is S.DONE:
            lines = (f"{index} {self.results[index].digest()}\n" for index in sorted(self.results))
            self.digest = hashlib.sha256("".join(lines).encode()).hexdigest()

    def lose_job(self) -> None:
        self.lost += [self.job] if self.job else []
        self.job = None

    @rule(lease_s=st.sampled_from([0.0, 0.0, LONG_S]))
    def claim(self, lease_s) -> None:
        found = self.store.jobs.claim("somebody", lease_s)
        if not self.queued or self.leased:
            assert found is None
            return
        self.lose_job()
        self.attempts = 1 if len(self.results) > self.progress else self.attempts + 1
        self.progress = len(self.results)
        if self.attempts > MAX_ATTEMPTS:
            assert found is None
            self.queued = False
            if S.DEAD in MOVES[self.state]:
                self.moved(S.DEAD)
            return
        assert (found.subject, found.attempts) == (self.campaign.id, self.attempts)
        self.job, self.leased = found, lease_s > 0.0

    @rule(lease_s=st.sampled_from([0.0, LONG_S]))
    def renew(self, lease_s) -> None:
        if self.job:
            assert self.store.jobs.renew(self.job, lease_s)
            self.leased = lease_s > 0.0

    @rule()
    def finish(self) -> None:
        if self.job:
            assert self.store.jobs.finish(self.job)
            self.lose_job()
            self.queued = self.leased = False

    @rule()
    def meddle(self) -> None:
        for job in self.lost:
            assert not self.store.jobs.renew(job, LONG_S)
            assert not self.store.jobs.finish(job)

    @invariant()
    def accounted(self) -> None:
        found = self.store.campaigns.get(self.campaign.id)
        outcomes = [each.outcome for each in self.results.values()]
        failed = outcomes.count(Outcome.ERRORED)
        crashes = outcomes.count(Outcome.COLLISION)
        done = len(outcomes) - failed
        wanted = Counts(PLANNED, done, crashes, failed, self.cancelled, self.again)
        assert (found.counts, found.state, found.digest) == (wanted, self.state, self.digest)
        assert found.counts.open >= 0
        stored = self.store.episodes.page(self.campaign.id, 100).items
        digests = {row.index: row.digest for row in stored}
        assert digests == {index: each.digest() for index, each in self.results.items()}


def run(opened, examples: int) -> None:
    """Let the machine live many lives."""
    run_state_machine_as_test(
        lambda: Life(opened),
        settings=lives(examples, 50),
    )


def test_lives_in_memory() -> None:
    run(lambda: open_store("memory://"), 30)


def test_lives_in_sqlite(sqlite_template) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "eigenfail.db"

        def opened():
            for old in Path(folder).iterdir():
                old.unlink()
            shutil.copy(sqlite_template, path)
            return open_store(f"sqlite:///{path}")

        run(opened, 12)
