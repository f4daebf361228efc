"""Campaigns that a test runs in its own process, with neither a hub nor workers."""

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.records import Delivery
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.rounds import Rounds, run_in_process


def run_here(store, number, episodes=None, active_s=0.0, because=""):
    """Run a queued campaign, or so many episodes of it, as the service does.

    Returns:
        Its id; the campaign still runs if episodes are left.
    """
    spec = store.campaigns.move(number, CampaignState.RUNNING).spec
    count = spec.episodes if episodes is None else episodes
    method = plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    context = learner_context(store.campaigns.get(number), store)
    rounds = Rounds(method(context, settings), spec.seed, count)
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    results = run_in_process(rounds, engine) if count else ()
    store.episodes.commit(number, [Delivery(result, "by hand") for result in results])
    store.checkpoints.save(number, rounds.checkpoint())
    store.campaigns.add_active(number, active_s)
    if count == spec.episodes:
        store.campaigns.move(number, CampaignState.DONE, because)
    return number
