"""The heap of workers that should get more, against a plain list."""

from hypothesis import given
from hypothesis import strategies as st

from eigenfail_services.hub.scheduler import MAX_STALE_ENTRIES, LeastLoaded

WORKERS = st.sampled_from([b"a", b"b", b"c", b"d"])
CHANGES = st.lists(st.tuples(WORKERS, st.none() | st.integers(0, 5)), max_size=300)


@given(CHANGES)
def test_the_one_with_least_is_first_and_of_equals_the_one_that_has_been_so_for_longest(
    changes: list[tuple[bytes, int | None]],
) -> None:
    heap, loads = LeastLoaded(), dict[bytes, int]()
    for worker, load in changes:
        loads.pop(worker, None)
        if load is None:
            heap.remove(worker)
        else:
            heap.put(worker, load)
            loads[worker] = load
        first = heap.first()
        assert (first and first[-1]) == min(loads, key=loads.__getitem__, default=None)


def test_it_holds_no_more_than_twice_as_much_as_there_are() -> None:
    heap = LeastLoaded()
    for n in range(10_000):
        heap.put(b"%d" % (n % 100), float(-n))
    assert len(heap._heap) <= 2 * 100 + MAX_STALE_ENTRIES
