"""Answers are worked out once for as long as no result comes in."""

from contextlib import closing
from threading import Barrier, Thread

import deadlines
import pytest

from eigenfail_services.store.query_cache import AnswerCache
from eigenfail_services.store.store import open_store

CROWD = 8


def test_who_asks_at_the_same_time_shares_one_answer() -> None:
    memo, made, found, start = AnswerCache(), [], [], Barrier(CROWD)

    def make() -> int:
        made.append(1)
        return 7

    def ask() -> None:
        start.wait(deadlines.CAMPAIGN_S)
        found.append(memo.get("course", 3, make))

    crowd = [Thread(target=ask) for _ in range(CROWD)]
    for each in crowd:
        each.start()
    for each in crowd:
        each.join(deadlines.CAMPAIGN_S)
    assert (found, made) == ([7] * CROWD, [1])


def test_a_further_result_makes_it_anew() -> None:
    memo = AnswerCache()
    assert memo.get("course", 0, lambda: "nothing") == "nothing"
    assert memo.get("course", 1, lambda: "one") == "one"
    assert memo.known("course", 1) == "one"
    assert memo.known("course", 2) is None


def test_an_answer_that_failed_is_asked_for_again() -> None:
    memo = AnswerCache()
    with pytest.raises(ZeroDivisionError):
        memo.get("course", 1, lambda: 1 // 0)
    assert memo.get("course", 1, lambda: 5) == 5


def test_the_oldest_questions_are_forgotten() -> None:
    memo = AnswerCache(most=2)
    for key in "abc":
        memo.put(key, 1, key)
    assert [memo.known(key, 1) for key in "bc"] == ["b", "c"]
    assert memo.known("a", 1) is None


def test_stores_answer_for_themselves() -> None:
    with closing(open_store("memory://")) as one, closing(open_store("memory://")) as other:
        assert one.answers.get("q", None, object) is one.answers.get("q", None, object)
        assert one.answers.get("q", None, object) is not other.answers.get("q", None, object)
