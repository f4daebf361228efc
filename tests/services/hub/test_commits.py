"""Nothing is acknowledged before it is written, and nothing is written twice because of a fault."""

import pytest

from eigenfail.errors import NotFound, StoreUnavailable
from eigenfail.values.episode import EpisodeFault, EpisodeTask, PriorSource, unrunnable
from eigenfail.values.records import Verdict
from eigenfail_services.hub import commits
from eigenfail_services.hub.commits import CommitQueue


class Episodes:
    """An episode store that can be away, for all or for one campaign."""

    def __init__(self) -> None:
        self.written: list[tuple[int, int]] = []
        self.away: set[int] = set()
        self.transactions = 0

    def commit(self, campaign, deliveries, meanwhile):
        meanwhile()
        if campaign in self.away:
            raise StoreUnavailable("The disk is full.")
        self.transactions += 1
        self.written += [(campaign, delivery.result.index) for delivery in deliveries]
        return [Verdict.KEPT] * len(deliveries)


def result(index: int):
    return unrunnable(EpisodeTask(index, 0, PriorSource()), EpisodeFault("input", "test"))


@pytest.fixture
def episodes() -> Episodes:
    return Episodes()


@pytest.fixture
def group(episodes: Episodes) -> CommitQueue:
    return CommitQueue(episodes)  # type: ignore[arg-type]


def test_results_wait_for_each_other(group: CommitQueue, episodes: Episodes) -> None:
    for index in range(5):
        group.add(b"w", "w", 1, result(index))
        assert group.flush() == []
    assert [c.result.index for c in group.flush(now=True)] == list(range(5))
    assert episodes.transactions == 1


def test_a_group_has_a_bound_unless_all_are_to_be_written(group: CommitQueue) -> None:
    for index in range(3 * commits.MAX_RESULTS):
        group.add(b"w", "w", 1, result(index))
    first, rest = group.flush(), group.flush(now=True)
    assert [len(first), len(rest)] == [commits.MAX_RESULTS, 2 * commits.MAX_RESULTS]
    assert [c.result.index for c in first + rest] == list(range(3 * commits.MAX_RESULTS))


def test_a_due_group_is_written(group: CommitQueue, monkeypatch: pytest.MonkeyPatch) -> None:
    group.add(b"w", "w", 1, result(0))
    now_s = commits.time.monotonic()
    monkeypatch.setattr(commits.time, "monotonic", lambda: now_s + 2 * commits.MAX_WAIT_S)
    assert len(group.flush()) == 1


def test_nothing_is_lost_while_the_store_is_away(group: CommitQueue, episodes: Episodes) -> None:
    episodes.away = {1}
    group.add(b"w", "w", 1, result(0))
    with pytest.raises(StoreUnavailable):
        group.flush(now=True)
    episodes.away = set()
    assert [c.result.index for c in group.flush(now=True)] == [0]
    assert group.flush(now=True) == []


def test_one_campaign_s_trouble_leaves_the_others_written_once(group, episodes) -> None:
    episodes.away = {2}
    group.add(b"w", "w", 1, result(0))
    group.add(b"w", "w", 2, result(0))
    assert [c.campaign for c in group.flush(now=True)] == [1]
    episodes.away = set()
    assert [c.campaign for c in group.flush(now=True)] == [2]
    assert episodes.written == [(1, 0), (2, 0)]


def test_what_comes_during_a_commit_is_written_by_the_next_one(episodes: Episodes) -> None:
    late = [result(1), result(2)]
    group = CommitQueue(
        episodes,  # type: ignore[arg-type]
        meanwhile=lambda: group.add(b"w", "w", 1, late.pop(0)) if late else None,
    )
    group.add(b"w", "w", 1, result(0))
    assert [c.result.index for c in group.flush(now=True)] == [0]
    episodes.away = {1}
    with pytest.raises(StoreUnavailable):
        group.flush(now=True)
    episodes.away = set()
    assert [c.result.index for c in group.flush(now=True)] == [1, 2]
    assert episodes.written == [(1, 0), (1, 1), (1, 2)]


def test_results_of_a_campaign_that_is_not_here_are_unwanted(group, episodes, monkeypatch) -> None:
    def nowhere(campaign, _deliveries, _meanwhile):
        raise NotFound(f"Campaign {campaign} does not exist.")

    group.add(b"w", "w", 7, result(0))
    monkeypatch.setattr(episodes, "commit", nowhere)
    assert [c.verdict for c in group.flush(now=True)] == [Verdict.UNWANTED]
    assert group.flush(now=True) == []
