"""Values that were computed from a store, kept until what they were computed from changes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from eigenfail_services.store import Store

Value = TypeVar("Value")


class _CachedValue(NamedTuple, Generic[Value]):
    """A value with the state that it was computed from."""

    state: Hashable
    value: Value


class StoreCache(Generic[Value]):
    """One value for each subject of each store; the least recently used ones are dropped.

    Safe to use from many threads: two may work out the same, and both are right.

    Args:
        most: how many are kept of each store.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = Lock()
        # The keys are weak, so that a store that is no longer used takes its values with it.
        self._stores: WeakKeyDictionary[Store, OrderedDict[Hashable, _CachedValue[Value]]] = (
            WeakKeyDictionary()
        )

    def get(
        self, store: Store, subject: Hashable, state: Hashable, make: Callable[[], Value]
    ) -> Value:
        """Return the value of a subject in a state, from the cache or computed now.

        Args:
            store: store that it is made of.
            subject: what the value belongs to, such as an id.
            state: whatever changes when the value does; read before the value is made.
            make: makes it.
        """
        with self._lock:
            kept = self._stores.setdefault(store, OrderedDict()).get(subject)
        if kept is None or kept.state != state:
            # The lock is not held: computing a value may take seconds, and other threads ask for
            # other subjects.
            kept = _CachedValue(state, make())
        with self._lock:
            ours = self._stores.setdefault(store, OrderedDict())
            ours[subject] = kept
            ours.move_to_end(subject)
            if len(ours) > self._most:
                ours.popitem(last=False)
        return kept.value
