"""Batches of noise that estimators request one after the other, in waves, or side by side."""

import numpy as np
import pytest

from eigenfail_services.statistics.batches import (
    Requester,
    answer_requests,
    run_in_waves,
    run_side_by_side,
)


def part(number, sizes, seen):
    """Requests batches of these sizes, filled with its number, and keeps the answers."""
    for size in sizes:
        answer = yield (np.full((size, 1, 2), float(number)),)
        seen.append((number, answer.tolist()))


def requested(combine, *parts):
    """The batches of all parts in the order in which they are answered, and the answers."""
    seen, batches = [], []

    def measure(z):
        batches.append(z[:, 0, 0].astype(int).tolist())
        return z[:, 0, 0]

    answer_requests(combine([part(n, sizes, seen) for n, sizes in enumerate(parts)]), measure)
    return batches, seen


def test_side_by_side_each_part_goes_on_once_its_own_batch_was_answered():
    batches, seen = requested(run_side_by_side, (2, 1, 1), (1,), (3, 1))
    assert batches == [[0, 0], [1], [2, 2, 2], [0], [2], [0]]
    assert seen == [(batch[0], batch) for batch in batches]


def test_in_waves_all_parts_go_on_together():
    batches, seen = requested(run_in_waves, (2, 1, 1), (1,), (3, 1))
    assert batches == [[0, 0, 1, 2, 2, 2], [0, 2], [0]]
    assert [number for number, _ in seen] == [0, 1, 2, 0, 2, 0]


@pytest.mark.parametrize("combine", [run_side_by_side, run_in_waves])
def test_parts_that_request_nothing_end_at_once(combine):
    assert requested(combine, (), ()) == ([], [])
    assert requested(combine) == ([], [])
    assert requested(combine, (), (1,))[0] == [[1]]


def test_parts_of_parts_are_answered_in_the_order_of_their_requests():
    seen = []
    inner = [part(0, (1, 1), seen), part(1, (1, 1), seen)]
    requester = Requester(run_side_by_side([run_side_by_side(inner), part(2, (1, 1), seen)]))
    waiting = list(requester.start())
    while waiting:
        waiting += requester.answer(waiting.pop(0)[:, 0, 0])
    assert [number for number, _ in seen] == [0, 1, 2, 0, 1, 2]
