"""Lists on a service as sequences: length, places and slices, and what is asked for them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from store_checks.examples import deliver, result, running

from eigenfail.testing.examples import collision
from eigenfail.values.rows import Rows

PLACES = st.none() | st.integers(-7, 7)
STEPS = st.none() | st.integers(-3, 3).filter(bool)


def rows_of(count, *, is_counted, is_reversible):
    """A list of numbers that may know its length, and may be read from its end."""
    numbers = range(count)
    return Rows(
        lambda: iter(numbers),
        start=lambda most: iter(numbers[:most]),
        count=(lambda: count) if is_counted else None,
        backwards=(lambda most: iter(numbers[::-1][:most])) if is_reversible else None,
    )


@given(st.integers(0, 6), st.booleans(), st.booleans(), st.tuples(PLACES, PLACES, STEPS))
def test_a_slice_is_that_of_a_tuple(count, is_counted, is_reversible, bounds):
    rows = rows_of(count, is_counted=is_counted, is_reversible=is_reversible)
    assert rows[slice(*bounds)] == tuple(range(count))[slice(*bounds)]
    assert len(rows) == count
    assert bool(rows) == bool(count)


@given(st.integers(0, 6), st.booleans(), st.booleans(), st.integers(-7, 7))
def test_a_place_is_that_of_a_tuple(count, is_counted, is_reversible, place):
    rows = rows_of(count, is_counted=is_counted, is_reversible=is_reversible)
    if -count <= place < count:
        assert rows[place] == range(count)[place]
    else:
        with pytest.raises(IndexError, match=f"There is no row {place}"):
            _ = rows[place]


@pytest.fixture
def campaign(store):
    made = running(store, episodes=40)
    deliver(
        store, made, *(collision(index) if index % 5 == 0 else result(index) for index in range(9))
    )
    return made


@pytest.fixture
def asked(client, monkeypatch):
    """The limits of the pages that were asked for."""
    limits, get = [], client._link.get

    def note(path, kind, params=None):
        limits.append((params or {}).get("limit"))
        return get(path, kind, params)

    monkeypatch.setattr(client._link, "get", note)
    return limits


def test_what_is_asked_for_is_what_is_wanted(client, campaign, asked):
    episodes = client.episodes.list(campaign)
    assert [row.index for row in episodes[2:4]] == [2, 3]
    assert asked == [4]
    assert episodes[-1].index == 8
    assert [row.index for row in episodes[-3:]] == [6, 7, 8]
    assert asked[1:] == [1, 3]
    assert len(episodes) == 9
    assert asked[3:] == [1]
    assert episodes
    assert not client.episodes.list(campaign, filter="severity > 1e9")
    assert asked[4:] == [1, 1]


def test_a_filtered_list_has_its_own_length_and_end(client, campaign):
    failures = client.episodes.list(campaign, "collision")
    assert (len(failures), failures[0].index, failures[-1].index) == (2, 0, 5)
    picked = client.episodes.list(campaign, filter="index >= 4", fields=["index"], sort="-index")
    assert (len(picked), picked[0], picked[-1]) == (5, {"index": 8}, {"index": 4})
    worst = client.episodes.list(campaign, sort="-severity")
    assert worst[-1].severity is None
    assert len(worst[::2]) == 5


def test_campaigns_have_a_length_and_an_end(client, campaign, fields):
    made = [client.campaigns.create(**fields).id for _ in range(3)]
    assert (len(client.campaigns.list()), len(client.campaigns.list(state="queued"))) == (4, 3)
    assert [each.id for each in client.campaigns.list()[:2]] == made[:0:-1]
    assert client.campaigns.list()[-1].id == campaign.id
    assert client.campaigns.list(sort="name")[-1].spec.name == "first"
    assert len(client.campaigns.summaries()) == 4
    assert (len(client.suites.list()), len(client.analyses.list(campaign))) == (0, 0)


@given(st.integers(0, 6), st.booleans(), st.booleans())
def test_rows_are_read_from_the_last_one_on(count, is_counted, is_reversible):
    rows = rows_of(count, is_counted=is_counted, is_reversible=is_reversible)
    assert [*reversed(rows)] == [*range(count)][::-1]


@pytest.mark.parametrize("collect", [list, tuple, sorted, lambda rows: [*rows]])
@pytest.mark.parametrize("is_counted", [False, True])
def test_rows_are_collected_in_one_walk_that_nothing_counts(collect, is_counted):
    walks, counts = [], []

    def fetch():
        walks.append(1)
        yield from range(5)

    def count():
        counts.append(1)
        return 5

    rows = Rows(fetch, count=count if is_counted else None)
    assert [*collect(rows)] == [0, 1, 2, 3, 4]
    assert (len(walks), len(counts)) == (1, 0)
    walk = iter(rows)
    assert (next(walk), len(rows), [*walk]) == (0, 5, [1, 2, 3, 4])
    assert len(walks) == (2 if is_counted else 3)


def test_a_walk_that_fails_is_never_taken_for_its_end():
    def fetch():
        yield 0
        raise TypeError("cut off")

    with pytest.raises(TypeError, match="cut off"):
        list(Rows(fetch))


def test_pages_are_asked_for_once_and_backwards(client, campaign, asked, monkeypatch):
    monkeypatch.setattr("eigenfail.client.link.PAGE", 4)
    episodes = client.episodes.list(campaign)
    assert [row.index for row in list(episodes)] == [*range(9)]
    assert asked == [4, 4, 4]
    assert [row.index for row in reversed(episodes)] == [*range(9)][::-1]
    assert asked[3:] == [4, 4, 4]
