"""Triage, as a client sees it: state, owner, labels, ticket and notes of modes and episodes."""

from collections.abc import Sequence
from typing import TypedDict, Unpack, overload

from eigenfail.client.link import Link
from eigenfail.client.references import (
    AnalysisLike,
    CampaignLike,
    EpisodeLike,
    ModeLike,
    ModesLike,
    find_mode_numbers,
    locate_analysis,
    locate_campaign,
    locate_episode,
    locate_mode,
    split_text,
)
from eigenfail.frames import Rows
from eigenfail.values import Mode, Page
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.triage import (
    EpisodesTriage,
    ModesTriage,
    NoteText,
    Triage,
    TriageChange,
    TriageCount,
    TriageNote,
    TriageState,
)
from eigenfail.wire.http import read_fields


class TriageFields(TypedDict, total=False):
    """Fields of a change of triage; those that are left out do not change.

    Attributes:
        state: new, confirmed, known, fixed or not_a_bug.
        owner: who works on it; empty for none.
        labels: all labels that it is to have from now on.
        add_labels: labels that it is to have besides.
        remove_labels: labels that it is not to have any more.
        ticket: address of its ticket, beginning with https:// or http://; empty for none.
    """

    state: TriageState | str
    owner: str
    labels: Sequence[str]
    add_labels: Sequence[str]
    remove_labels: Sequence[str]
    ticket: str


class TriageRecords:
    """Read and change the triage of failure modes and episodes, and their notes.

    Changes and notes need a key of the scope runner where keys are required. Every method raises
    InvalidValue for a value that names no such thing, and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def get_mode(self, analysis: AnalysisLike, mode: ModeLike | None = None) -> Triage:
        """Return the triage of a failure mode.

        Args:
            analysis: the analysis, or its id; or the mode, as lists have it.
            mode: the mode, or its number, from 1; left out where `analysis` is the mode.

        Raises:
            NotFound: no such analysis or mode.
        """
        return self._link.get(f"{locate_mode(analysis, mode)}/triage", Triage)

    def get_episode(self, campaign: CampaignLike, index: EpisodeLike | None = None) -> Triage:
        """Return the triage of an episode.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
        """
        return self._link.get(f"{locate_episode(campaign, index)}/triage", Triage)

    def change_mode(
        self, analysis: AnalysisLike, mode: ModeLike | None = None, **fields: Unpack[TriageFields]
    ) -> Triage:
        """Change the triage of a failure mode, and return it.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: a value is outside its bounds, or the ticket is no address.
        """
        change = read_fields(fields, TriageChange)
        return self._link.post(f"{locate_mode(analysis, mode)}/triage", Triage, change)

    def change_modes(
        self, analysis: AnalysisLike, modes: ModesLike, **fields: Unpack[TriageFields]
    ) -> TriageCount:
        """Change the triage of several failure modes: of all of them, or of none.

        Args:
            analysis: the analysis, or its id.
            modes: the modes, or their numbers, from 1.
            fields: what changes.

        Raises:
            NotFound: no such analysis, or it lacks one of the modes.
            InvalidValue: a value is outside its bounds, or the ticket is no address.
        """
        numbers = find_mode_numbers(analysis, modes)
        asked = read_fields({"modes": numbers, "change": fields}, ModesTriage)
        return self._link.post(f"{locate_analysis(analysis)}/modes/triage", TriageCount, asked)

    def change_episode(
        self,
        campaign: CampaignLike,
        index: EpisodeLike | None = None,
        **fields: Unpack[TriageFields],
    ) -> Triage:
        """Change the triage of an episode, and return it.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
            InvalidValue: a value is outside its bounds, or the ticket is no address.
        """
        change = read_fields(fields, TriageChange)
        return self._link.post(f"{locate_episode(campaign, index)}/triage", Triage, change)

    def change_episodes(
        self,
        campaign: CampaignLike,
        filter: str,  # noqa: A002 - the word that users know it by
        **fields: Unpack[TriageFields],
    ) -> TriageCount:
        """Change the triage of all episodes that match a filter: of all of them, or of none.

        Args:
            campaign: the campaign, or its id.
            filter: conditions, as for `client.episodes.list`; empty for every episode.
            fields: what changes.

        Raises:
            NotFound: no such campaign.
            UnknownName: a column or a value that there is not.
            InvalidValue: a filter that cannot be read or matches more than 20,000 episodes, a
                value outside its bounds, or a ticket that is no address.
        """
        asked = read_fields({"filter": filter, "change": fields}, EpisodesTriage)
        return self._link.post(f"{locate_campaign(campaign)}/episodes/triage", TriageCount, asked)

    def list_mode_notes(
        self, analysis: AnalysisLike, mode: ModeLike | None = None
    ) -> Rows[TriageNote]:
        """Return the notes on a failure mode, newest first.

        Raises:
            NotFound: no such analysis or mode.
        """
        path = f"{locate_mode(analysis, mode)}/notes"
        return self._link.pages(path, Page[TriageNote], "before")

    def list_episode_notes(
        self, campaign: CampaignLike, index: EpisodeLike | None = None
    ) -> Rows[TriageNote]:
        """Return the notes on an episode, newest first.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
        """
        path = f"{locate_episode(campaign, index)}/notes"
        return self._link.pages(path, Page[TriageNote], "before")

    @overload
    def add_mode_note(self, analysis: Mode, mode: str, text: None = None) -> TriageNote: ...

    @overload
    def add_mode_note(
        self, analysis: AnalysisLike, mode: ModeLike | None = None, *, text: str
    ) -> TriageNote: ...

    @overload
    def add_mode_note(self, analysis: AnalysisLike, mode: ModeLike, text: str) -> TriageNote: ...

    def add_mode_note(
        self, analysis: AnalysisLike, mode: ModeLike | str | None = None, text: str | None = None
    ) -> TriageNote:
        """Add a note to a failure mode, and return it.

        Args:
            analysis: the analysis, or its id; or the mode, as lists have it.
            mode: the mode, or its number, from 1; left out where `analysis` is the mode:
                `add_mode_note(mode, "late")`.
            text: the note.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: the text is missing, empty, too long, or cannot be printed.
        """
        number, words = split_text("text", mode, text)
        note = read_fields({"text": words}, NoteText)
        return self._link.post(f"{locate_mode(analysis, number)}/notes", TriageNote, note)

    @overload
    def add_episode_note(
        self, campaign: EpisodeRow | EpisodeDetail, index: str, text: None = None
    ) -> TriageNote: ...

    @overload
    def add_episode_note(
        self, campaign: CampaignLike, index: EpisodeLike | None = None, *, text: str
    ) -> TriageNote: ...

    @overload
    def add_episode_note(
        self, campaign: CampaignLike, index: EpisodeLike, text: str
    ) -> TriageNote: ...

    def add_episode_note(
        self,
        campaign: CampaignLike,
        index: EpisodeLike | str | None = None,
        text: str | None = None,
    ) -> TriageNote:
        """Add a note to an episode, and return it.

        Args:
            campaign: the campaign, or its id; or the episode, as lists have it.
            index: the episode, or its index; left out where `campaign` is the episode:
                `add_episode_note(row, "late")`.
            text: the note.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
            InvalidValue: the text is missing, empty, too long, or cannot be printed.
        """
        episode, words = split_text("text", index, text)
        note = read_fields({"text": words}, NoteText)
        return self._link.post(f"{locate_episode(campaign, episode)}/notes", TriageNote, note)
