"""Campaigns that are made once for each key."""

from eigenfail.testing.store.examples import spec
from eigenfail_services.store.creation import hash_of, key_of


def test_keys_of_places_are_different_and_short() -> None:
    keys = {key_of(key, place) for key in ("a", "b", "x" * 200) for place in range(20)}
    assert len(keys) == 60
    assert max(map(len, keys)) <= 200


def test_a_list_is_recognised_by_what_is_in_it_and_by_its_order() -> None:
    one, other = spec(seed=1), spec(seed=2)
    lists = [(), (one,), (other,), (one, other), (other, one), (one, one)]
    assert len({hash_of(each) for each in lists}) == len(lists)
    assert hash_of([spec(seed=1)]) == hash_of((one,))
