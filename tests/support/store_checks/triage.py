"""Checks of triage: what is changed stays, what is refused changes nothing, notes only grow."""

from threading import Thread

from msgspec.structs import replace

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.filters import parse_filter
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import (
    MOST_LABELS,
    UNTOUCHED,
    Triage,
    TriageChange,
    TriageCount,
    TriageFilter,
    TriageState,
)
from eigenfail_services.store import Store
from eigenfail_services.store.triage import episode_subject, mode_subject
from eigenfail_services.store.triage_rows import TriageKind
from store_checks.examples import BEYOND, equal
from store_checks.modes import analysed, crashed

CONFIRMED = TriageChange(TriageState.CONFIRMED, "anna", labels=("braking", "late"))
CLERKS = 8


def found(store: Store, campaign: int, text: str) -> list[int]:
    """The indices of the episodes that a filter finds."""
    return [row.index for row in store.episodes.page(campaign, 100, where=parse_filter(text)).items]


def keeps_triage_of_modes_and_episodes(store: Store) -> None:
    """It is that of one subject, and what a change leaves out stays as it is."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    mode, episode = mode_subject(analysis, 1), episode_subject(campaign.id, 1)
    for subject in (mode, episode):
        equal(store.triage.get(subject), UNTOUCHED, "Triage before the first change")
        first = store.triage.change(subject, CONFIRMED, "anna's key")
        told = (first.state, first.owner, first.labels, first.ticket, first.changed_by)
        wanted = (TriageState.CONFIRMED, "anna", ("braking", "late"), "", "anna's key")
        equal(told, wanted, "The first change")
        later = TriageChange(
            ticket="https://tickets/7", add_labels=("Ö",), remove_labels=("late", "?")
        )
        second = store.triage.change(subject, later, "another")
        wanted_later = replace(
            first, ticket="https://tickets/7", labels=("braking", "Ö"), changed_by="another"
        )
        equal(replace(second, changed_ms=first.changed_ms), wanted_later, "The second change")
        equal(store.triage.get(subject), second, "Triage, asked for")
        equal(store.triage.change(subject, later, "anna's key"), second, "The same change again")
    equal(store.triage.get(mode_subject(analysis, 2)), UNTOUCHED, "Triage of another mode")
    equal(store.triage.get(episode_subject(campaign.id, 0)), UNTOUCHED, "Of another episode")


def shows_triage_in_lists(store: Store) -> None:
    """Rows of episodes and modes have state, owner and labels, and a filter of modes compares."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    digest = store.episodes.digest(campaign.id)
    store.triage.change(mode_subject(analysis, 2), CONFIRMED, "anna")
    store.triage.change(episode_subject(campaign.id, 2), CONFIRMED, "anna")
    rows = store.episodes.page(campaign.id, 10).items
    usual = (TriageState.NEW, "", ())
    triaged = (TriageState.CONFIRMED, "anna", ("braking", "late"))
    equal(
        [(row.state, row.owner, row.labels) for row in rows],
        [usual, usual, triaged, usual],
        "Triage of the rows",
    )
    modes = store.analyses.modes(analysis)
    equal([(m.state, m.owner, m.labels) for m in modes], [usual, triaged], "Triage of the modes")
    for where, numbers in (
        (TriageFilter(TriageState.NEW), [1]),
        (TriageFilter(TriageState.CONFIRMED, "anna", "late"), [2]),
        (TriageFilter(owner=""), [1]),
        (TriageFilter(label="lat"), []),
    ):
        listed = [mode.number for mode in store.analyses.modes(analysis, where)]
        equal(listed, numbers, f"Modes with {where}")
    equal(store.analyses.find_modes(campaign.id, 1)[0].owner, "anna", "The mode of an episode")
    equal(store.analyses.rename_mode(analysis, 2, "x").labels, ("braking", "late"), "Renamed")
    equal(store.episodes.digest(campaign.id), digest, "The digest after triage")


def filters_episodes_by_triage(store: Store) -> None:
    """A state is that of episodes without triage, too; a label is found whole, in its letters."""
    campaign, other = crashed(store, 5), crashed(store)
    for index, change in (
        (1, CONFIRMED),
        (2, TriageChange(TriageState.KNOWN, labels=("late",))),
        (3, TriageChange(labels=("Late", "late %_\\"))),
    ):
        store.triage.change(episode_subject(campaign.id, index), change, "anna")
    store.triage.change(episode_subject(other.id, 0), CONFIRMED, "anna")
    for text, wanted in (
        ("state = new", [0, 3, 4]),
        ("state != new", [1, 2]),
        ("state = confirmed", [1]),
        ("state != confirmed and state != known", [0, 3, 4]),
        ("owner = anna", [1]),
        ("owner = ''", [0, 2, 3, 4]),
        ("owner != ''", [1]),
        ("label = late", [1, 2]),
        ("label != late", [0, 3, 4]),
        ("label = 'late %_\\'", [3]),
        ("label = lat", []),
        ("label = ''", [0, 4]),
        ("label != ''", [1, 2, 3]),
        ("label = '' and state = new", [0, 4]),
        ("label = late and label = braking and severity > 10.5", [1]),
        ("state = new and severity < 12", [0]),
    ):
        equal(found(store, campaign.id, text), wanted, f"Episodes with {text}")


def changes_many_at_once(store: Store) -> None:
    """All that match, and it is told how many are other than before."""
    campaign = crashed(store, 5)
    analysis = analysed(store, campaign, analysis_result())
    store.triage.change(episode_subject(campaign.id, 4), CONFIRMED, "anna")
    where = parse_filter("severity >= 12")
    count = store.triage.change_episodes(campaign.id, where, CONFIRMED, "anna")
    equal(count, TriageCount(3, 2), "Episodes of which one was so already")
    equal(found(store, campaign.id, "state = confirmed"), [2, 3, 4], "What was changed")
    again = store.triage.change_episodes(campaign.id, where, CONFIRMED, "anna")
    equal(again, TriageCount(3, 0), "The same again")
    nothing = parse_filter("severity > 1000")
    none = store.triage.change_episodes(campaign.id, nothing, CONFIRMED, "anna")
    equal(none, TriageCount(0, 0), "No episode")
    modes = store.triage.change_modes(analysis, [2, 1, 2], CONFIRMED, "anna")
    equal(modes, TriageCount(2, 2), "Two modes")
    with expect_error(NotFound, "A mode that does not exist was changed."):
        store.triage.change_modes(analysis, [1, 3], TriageChange(owner="ben"), "ben")
    equal([m.owner for m in store.analyses.modes(analysis)], ["anna"] * 2, "After a refusal")


def changes_all_or_none(store: Store) -> None:
    """Where one of many would have too many labels, none is changed."""
    campaign = crashed(store)
    full = tuple(f"label {number}" for number in range(MOST_LABELS))
    store.triage.change(episode_subject(campaign.id, 3), TriageChange(labels=full), "anna")
    more = TriageChange(TriageState.KNOWN, add_labels=("one more",))
    with expect_error(InvalidValue, "An episode had too many labels."):
        store.triage.change_episodes(campaign.id, (), more, "anna")
    equal(found(store, campaign.id, "state = known"), [], "Episodes after the refusal")
    equal(found(store, campaign.id, "label = 'one more'"), [], "Labels after the refusal")


def adds_notes(store: Store) -> None:
    """Newest first, page by page, those of one subject alone."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    mode, episode = mode_subject(analysis, 1), episode_subject(campaign.id, 1)
    texts = [f"line\n{number} Ö" for number in range(5)]
    made = [store.triage.add_note(mode, text, "anna") for text in texts]
    store.triage.add_note(episode, "of an episode", "ben")
    first = store.triage.notes(mode, 2)
    second = store.triage.notes(mode, 3, first.next)
    equal((*first.items, *second.items), tuple(reversed(made)), "Notes on a mode")
    equal(second.next, None, "The cursor of the last page")
    equal([note.text for note in made], texts, "Texts of the notes")
    (other,) = store.triage.notes(episode, 9).items
    equal((other.author, other.text), ("ben", "of an episode"), "The note on an episode")
    equal(store.triage.get(mode), UNTOUCHED, "Triage of what has notes alone")


def lists_what_was_triaged(store: Store) -> None:
    """By number, without what was never changed; of the notes the newest, in order."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    for number in (3, 1, 2):
        subject = episode_subject(campaign.id, number)
        store.triage.change(subject, CONFIRMED, "anna's key")
        store.triage.add_note(subject, f"note {number}", "anna's key")
    store.triage.add_note(episode_subject(campaign.id, 1), "another", "bert")
    listed = store.triage.list_triaged(TriageKind.EPISODE, campaign.id, 2)
    equal([subject.number for subject, _ in listed], [1, 2], "Numbers of triaged episodes")
    first = episode_subject(campaign.id, 1)
    equal(listed[0], (first, store.triage.get(first)), "The first of them")
    notes = store.triage.list_notes(TriageKind.EPISODE, campaign.id, 3)
    told = [(subject.number, note.text) for subject, note in notes]
    equal(told, [(1, "note 1"), (1, "another"), (2, "note 2")], "The newest notes")
    equal(store.triage.list_triaged(TriageKind.MODE, analysis, 9), [], "Modes that were triaged")
    equal(store.triage.list_notes(TriageKind.MODE, analysis, 9), [], "Notes on modes")


def knows_no_strangers(store: Store) -> None:
    """What does not exist has no triage, and no note is added to it."""
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    strangers = [mode_subject(analysis, 3), episode_subject(campaign.id, 4)]
    strangers += [mode_subject(each, 1) for each in BEYOND]
    strangers += [episode_subject(each, 0) for each in BEYOND]
    for stranger in strangers:
        with expect_error(NotFound, f"{stranger} has triage."):
            store.triage.get(stranger)
        with expect_error(NotFound, f"{stranger} was changed."):
            store.triage.change(stranger, CONFIRMED, "anna")
        with expect_error(NotFound, f"{stranger} has a note."):
            store.triage.add_note(stranger, "none", "anna")
        with expect_error(NotFound, f"{stranger} has a list of notes."):
            store.triage.notes(stranger, 1)
    for unknown in BEYOND:
        with expect_error(NotFound, f"Episodes of campaign {unknown} were changed."):
            store.triage.change_episodes(unknown, (), CONFIRMED, "anna")


def loses_no_change_of_others(store: Store) -> None:
    """Labels that several add to one subject at a time are all there afterwards."""
    campaign = crashed(store)
    subject = episode_subject(campaign.id, 0)
    changes = [TriageChange(add_labels=(f"of clerk {number}",)) for number in range(CLERKS)]
    clerks = [
        Thread(target=store.triage.change, args=(subject, change, "clerk")) for change in changes
    ]
    for clerk in clerks:
        clerk.start()
    for clerk in clerks:
        clerk.join()
    kept: Triage = store.triage.get(subject)
    expect(len(kept.labels) == CLERKS, f"Of {CLERKS} labels, these were kept: {kept.labels}.")


CHECKS = (
    keeps_triage_of_modes_and_episodes,
    shows_triage_in_lists,
    filters_episodes_by_triage,
    changes_many_at_once,
    changes_all_or_none,
    adds_notes,
    lists_what_was_triaged,
    knows_no_strangers,
    loses_no_change_of_others,
)
