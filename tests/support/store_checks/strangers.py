"""Check of what does not exist: it is NotFound, whatever part of the store is asked for it."""

from collections.abc import Callable

from eigenfail.errors import NotFound
from eigenfail.testing import expect_error
from eigenfail.testing.examples import analysis_result
from eigenfail.values.access import UNLIMITED, Scope
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.operations import Retention
from eigenfail.values.triage import TriageChange
from eigenfail_services.store.store import Store
from store_checks.examples import BEYOND
from store_checks.modes import analysed, crashed

SETTINGS, NOTE, THIRDS = AnalysisSettings(), TriageChange(note="It brakes late."), Retention(3)
QUESTIONS: dict[str, Callable[[Store, int], object]] = {
    "get a campaign": lambda store, who: store.campaigns.get(who),
    "read references": lambda store, who: store.campaigns.read_references(who),
    "move": lambda store, who: store.campaigns.move(who, CampaignState.RUNNING),
    "add active time": lambda store, who: store.campaigns.add_active(who, 1.0),
    "begin a part": lambda store, who: store.campaigns.begin_part(who, {"numpy": "2.0"}),
    "archive": lambda store, who: store.campaigns.archive(who),
    "restore": lambda store, who: store.campaigns.restore(who),
    "prioritise": lambda store, who: store.campaigns.prioritise(who, Priority.HIGH),
    "commit": lambda store, who: store.episodes.commit(who, []),
    "get an episode": lambda store, who: store.episodes.get(who, 0),
    "add a death": lambda store, who: store.episodes.add_death(who, 0),
    "save a checkpoint": lambda store, who: store.checkpoints.save(who, b"state"),
    "recover a checkpoint": lambda store, who: store.checkpoints.recover(who),
    "prune": lambda store, who: store.retention.prune(who, THIRDS, "somebody"),
    "weigh": lambda store, who: store.retention.weigh(who, THIRDS),
    "create an analysis": lambda store, who: store.analyses.create(who, SETTINGS),
    "get an analysis": lambda store, who: store.analyses.get(who),
    "start": lambda store, who: store.analyses.start(who),
    "fail": lambda store, who: store.analyses.fail(who, "It cannot."),
    "list replays": lambda store, who: store.analyses.replays(who),
    "link to a stranger": lambda store, who: store.analyses.link_replay(who, 1),
    "link a stranger": lambda store, who: store.analyses.link_replay(1, who),
    "list modes": lambda store, who: store.analyses.modes(who),
    "get a mode": lambda store, who: store.analyses.mode(who, 1),
    "rename a mode": lambda store, who: store.analyses.rename_mode(who, 1, "none"),
    "get triage": lambda store, who: store.analyses.get_triage(who, 1),
    "change triage": lambda store, who: store.analyses.change_triage(who, 1, NOTE, "anna"),
    "find a key": lambda store, who: store.keys.find(who),
    "revoke a key": lambda store, who: store.keys.revoke(who),
    "limit a key": lambda store, who: store.keys.limit(who, UNLIMITED),
    "get a gate": lambda store, who: store.gates.get(who),
}
"""What is asked for with an id; a campaign, an analysis of it and a key have the id 1."""

QUESTIONS_OF_MODES: dict[str, Callable[[Store, int], object]] = {
    "rename a mode": lambda store, number: store.analyses.rename_mode(1, number, "none"),
    "get triage": lambda store, number: store.analyses.get_triage(1, number),
    "change triage": lambda store, number: store.analyses.change_triage(1, number, NOTE, "anna"),
}
"""What is asked for with the number of a mode of that analysis, which has two."""


def knows_no_strangers(store: Store) -> None:
    """An id that nothing has is NotFound, however odd it is."""
    campaign = crashed(store)
    analysed(store, campaign, analysis_result())
    store.keys.create("one", Scope.ADMIN, "0123456789abcdef" * 4)
    for questions, strangers in ((QUESTIONS, BEYOND), (QUESTIONS_OF_MODES, (0, 3))):
        for name, ask in questions.items():
            for stranger in strangers:
                with expect_error(NotFound, f"There was an answer to '{name}' for {stranger}."):
                    ask(store, stranger)
    for stranger in BEYOND[1:]:
        with expect_error(NotFound, f"Episode {stranger} was found."):
            store.episodes.get(campaign.id, stranger)
