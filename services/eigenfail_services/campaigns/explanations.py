"""Explanations of stored episodes; the last few are kept, since a process makes each."""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import sha256
from threading import Lock

from eigenfail.contracts import Store
from eigenfail.stories.explaining import explain_aside, question
from eigenfail.values import Explanation

KEPT = 32

Explain = Callable[[bytes], Explanation]


class Explanations:
    """Made when they are first asked for, one at a time.

    Args:
        explain: makes one of the question that `eigenfail.stories.explaining.question` puts.
    """

    def __init__(self, explain: Explain = explain_aside) -> None:
        self._explain = explain
        self._making = Lock()
        self._made: OrderedDict[bytes, Explanation] = OrderedDict()

    def of(self, store: Store, campaign: int, index: int) -> Explanation:
        """What the planner says of an episode; takes seconds if it was not asked for before.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
            InvalidValue: the episode has no course to explain.
            ServiceError: the world is not installed here, or there was no answer in time.
        """
        spec = store.campaigns.get(campaign).spec
        asked = question(campaign, spec, store.episodes.get(campaign, index))
        key = sha256(asked).digest()
        with self._making:
            told = self._made.get(key) or self._explain(asked)
            self._made[key] = told
            self._made.move_to_end(key)
            while len(self._made) > KEPT:
                self._made.popitem(last=False)
        return told
