"""What was worked out of a store before, and holds until what it was made of changes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from eigenfail.contracts import Store

Value = TypeVar("Value")


class Kept(NamedTuple, Generic[Value]):
    """A value, and the state of things that it was made of."""

    state: Hashable
    value: Value


class Remembered(Generic[Value]):
    """One value for each subject of each store; those that were asked for last are kept.

    Safe to use from many threads: two may work out the same, and both are right.

    Args:
        most: how many are kept of each store.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = Lock()
        self._stores: WeakKeyDictionary[Store, OrderedDict[Hashable, Kept[Value]]] = (
            WeakKeyDictionary()
        )

    def get(
        self, store: Store, subject: Hashable, state: Hashable, make: Callable[[], Value]
    ) -> Value:
        """The value for a subject in a state: known, or made now.

        Args:
            store: that it is made of.
            subject: what it tells of, such as an id.
            state: whatever changes when the value does; read before the value is made.
            make: makes it.
        """
        with self._lock:
            kept = self._stores.setdefault(store, OrderedDict()).get(subject)
        if kept is None or kept.state != state:
            kept = Kept(state, make())
        with self._lock:
            ours = self._stores.setdefault(store, OrderedDict())
            ours[subject] = kept
            ours.move_to_end(subject)
            if len(ours) > self._most:
                ours.popitem(last=False)
        return kept.value
