"""Checks of triage: what is changed stays, and what is refused changes nothing."""

from threading import Thread

from msgspec.structs import replace

from eigenfail.testing import expect
from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import Triage, TriageChange, TriageState
from eigenfail_services.store.store import Store
from store_checks.examples import equal
from store_checks.modes import analysed, crashed

CONFIRMED = TriageChange(TriageState.CONFIRMED, note="It brakes late.\nÖ")
CLERKS = 8


def keeps_triage_of_modes(store: Store) -> None:
    """It is that of one mode of one analysis, and what a change leaves out stays as it is."""
    campaign = crashed(store)
    analysis, other = (analysed(store, campaign, analysis_result()) for _ in range(2))
    equal(store.analyses.get_triage(analysis, 1), Triage(), "Triage before the first change")
    first = store.analyses.change_triage(analysis, 1, CONFIRMED, "anna's key")
    told = (first.state, first.ticket, first.note, first.changed_by)
    wanted = (TriageState.CONFIRMED, "", "It brakes late.\nÖ", "anna's key")
    equal(told, wanted, "The first change")
    later = TriageChange(ticket="https://tickets/7")
    second = store.analyses.change_triage(analysis, 1, later, "another")
    wanted_later = replace(first, ticket="https://tickets/7", changed_by="another")
    equal(replace(second, changed_ms=first.changed_ms), wanted_later, "The second change")
    equal(store.analyses.get_triage(analysis, 1), second, "Triage, asked for")
    equal(
        store.analyses.change_triage(analysis, 1, later, "anna's key"),
        second,
        "The same change again",
    )
    equal(store.analyses.get_triage(analysis, 2), Triage(), "Triage of another mode")
    equal(store.analyses.get_triage(other, 1), Triage(), "Triage of the mode of another analysis")
    emptied = store.analyses.change_triage(
        analysis, 1, TriageChange(ticket="", note=""), "anna's key"
    )
    equal((emptied.ticket, emptied.note), ("", ""), "What was taken away")


def shows_states_in_lists(store: Store) -> None:
    """Modes have the state of their triage, and a list of modes is filtered by it."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    digest = store.episodes.digest(campaign.id)
    store.analyses.change_triage(analysis, 2, CONFIRMED, "anna")
    for state, numbers in (
        (None, [1, 2]),
        (TriageState.NEW, [1]),
        (TriageState.CONFIRMED, [2]),
        (TriageState.FIXED, []),
    ):
        listed = [mode.number for mode in store.analyses.modes(analysis, state)]
        equal(listed, numbers, f"Modes of the state {state}")
    (mode,) = store.analyses.find_modes(campaign.id, 1)
    equal(mode.state, TriageState.CONFIRMED, "The mode of an episode")
    renamed = store.analyses.rename_mode(analysis, 2, "x")
    equal((renamed.name, renamed.state), ("x", TriageState.CONFIRMED), "The renamed mode")
    equal(
        store.analyses.get_triage(analysis, 2).note, CONFIRMED.note, "The note of the renamed mode"
    )
    equal(store.episodes.digest(campaign.id), digest, "The digest after triage")


def loses_no_change_of_others(store: Store) -> None:
    """Each of several changes at a time is made to what the one before has left."""
    analysis = analysed(store, crashed(store), analysis_result())
    seen: list[str] = []

    def add(name: str) -> None:
        def check(found: Triage) -> None:
            seen.append(found.note)

        store.analyses.change_triage(analysis, 1, TriageChange(note=name), name, check)

    names = [f"clerk {number}" for number in range(CLERKS)]
    clerks = [Thread(target=add, args=(name,)) for name in names]
    for clerk in clerks:
        clerk.start()
    for clerk in clerks:
        clerk.join()
    last = store.analyses.get_triage(analysis, 1).note
    equal(sorted([*seen, last]), sorted(["", *names]), "Notes that the changes have found")
    expect(last in names, f"The last note is of a clerk: {last}.")
