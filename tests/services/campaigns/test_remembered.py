"""What was worked out before is not worked out again, until its state changes."""

from eigenfail_services.campaigns.cache import StoreCache
from eigenfail_services.store import open_store


class Maker:
    def __init__(self):
        self.made = 0

    def __call__(self):
        self.made += 1
        return self.made


def test_a_value_is_made_once_for_each_state():
    known, store, make = StoreCache(10), open_store("memory://"), Maker()
    assert [known.get(store, 1, state, make) for state in ("a", "a", "b", "b", "a")] == [
        *(1, 1, 2, 2),
        3,  # of earlier states nothing is kept
    ]


def test_stores_and_subjects_are_told_apart():
    known, make = StoreCache(10), Maker()
    one, other = open_store("memory://"), open_store("memory://")
    asked = [known.get(*each, None, make) for each in ((one, 1), (one, 2), (other, 1), (one, 1))]
    assert asked == [1, 2, 3, 1]


def test_those_that_were_asked_for_last_are_kept():
    known, store, make = StoreCache(2), open_store("memory://"), Maker()
    assert [known.get(store, subject, None, make) for subject in (1, 2, 1, 3, 1, 2)] == [
        *(1, 2, 1, 3, 1),
        4,
    ]
