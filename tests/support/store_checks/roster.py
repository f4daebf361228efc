"""Checks of `Roster`."""

from eigenfail.values.operations import LONGEST_NAME, MOST_VERSIONS, Arrival, Presence
from eigenfail_services.store.store import Store
from store_checks.examples import equal

LONG_AGO, LATER = 0, 4_000_000_000_000
NOBODY = 2**70
CROWD = 1_200
"""More than one statement names."""


def arrival(worker: str = "w ½", host: str = "a host") -> Arrival:
    """A worker that comes."""
    return Arrival(worker=worker, host=host, pid=2**40, versions={"numpy": "2.4.6", "½": ""})


def keeps_who_is_there(store: Store) -> None:
    """Whoever came is there as told, by name, until it leaves; a second end changes nothing."""
    first, second = store.roster.arrived([arrival(name) for name in ("b", "a")])
    found = store.roster.present(LONG_AGO)
    equal([each.worker for each in found], ["a", "b"], "Who is there")
    equal(told(found[1]), arrival("b"), "What was told")
    equal(found[0].heard_ms, found[0].arrived_ms, "When it was heard first")
    store.roster.left([first])
    equal([each.id for each in store.roster.present(LONG_AGO)], [second], "Who stayed")
    gone = store.roster.last("b", LATER)
    store.roster.left([second, first])
    equal(store.roster.last("b", LATER), gone, "Who left twice")
    equal(store.roster.present(LONG_AGO), (), "Who is there at the end")


def tells_who_was_heard_lately(store: Store) -> None:
    """Somebody that was not heard since is not there, whether it left or not."""
    numbers = store.roster.arrived([arrival(name) for name in ("a", "b")])
    seen = store.roster.present(LONG_AGO)
    store.roster.heard([numbers[0], NOBODY])
    again = store.roster.present(LONG_AGO)
    equal(again[0].heard_ms >= seen[0].heard_ms, True, "Whether it was heard again")
    equal(again[1].heard_ms, seen[1].heard_ms, "When the other was heard")
    equal(store.roster.present(LATER), (), "Who is there much later")
    store.roster.heard([])
    equal(store.roster.present(LONG_AGO), again, "Who is there if nobody was heard")


def keeps_many_versions(store: Store) -> None:
    """As many, and as long, as the wire lets through."""
    many = {f"{n:03}".ljust(LONGEST_NAME, "½"): "1" * LONGEST_NAME for n in range(MOST_VERSIONS)}
    store.roster.arrived([Arrival(worker="w", host="h", pid=1, versions=many)])
    (found,) = store.roster.present(LONG_AGO)
    equal(found.versions, many, "The versions")


def finds_who_had_a_name(store: Store) -> None:
    """The latest under a name counts, up to a moment."""
    store.roster.arrived([arrival("w", "old host"), arrival("x", "other host")])
    store.roster.arrived([arrival("w", "new host")])
    found = store.roster.last("w", LATER)
    equal(found and found.host, "new host", "The host of the latest")
    equal(store.roster.last("w", LONG_AGO), None, "Before anybody came")
    equal(store.roster.last("nobody", LATER), None, "Nobody's name")
    store.roster.left([NOBODY])


def takes_a_crowd_at_a_time(store: Store) -> None:
    """However many come or go at once, each has a number of its own, in order; nobody is lost."""
    equal(store.roster.arrived([]), [], "The numbers of nobody")
    names = [f"{place:04}" for place in range(CROWD)]
    numbers = store.roster.arrived([arrival(name) for name in names])
    equal(numbers, sorted(set(numbers)), "The numbers")
    found = store.roster.present(LONG_AGO)
    equal([(each.worker, each.id) for each in found], [*zip(names, numbers, strict=True)], "Who")
    store.roster.heard(numbers)
    store.roster.left(numbers[1:])
    equal([each.id for each in store.roster.present(LONG_AGO)], numbers[:1], "Who stayed")
    store.roster.left([])
    later = store.roster.arrived([arrival()])
    equal(later[0] > numbers[-1], True, "Whether numbers rise")


def told(presence: Presence) -> Arrival:
    """What it told when it came."""
    return Arrival(
        worker=presence.worker,
        host=presence.host,
        pid=presence.pid,
        versions=presence.versions,
    )
