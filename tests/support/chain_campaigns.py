"""Campaigns of chains, from the failures of an earlier campaign, run in this process."""

from accepted import accept_spec

from eigenfail import plugins
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Delivery
from eigenfail_services.campaigns.drafts import validate_campaign
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.store.store import Store, open_store

CHAINS, EPISODES = 5, 120


class Campaigns:
    """Campaigns of a planner that fails often, run in this process."""

    def __init__(self) -> None:
        self.store: Store = open_store("memory://")
        self.before = self.run(method="monte_carlo", episodes=30)

    def create(self, **fields) -> int:
        given = {"name": "t", "planner": "idm", "simulator": "point_mass"} | fields
        spec = validate_campaign(CampaignSpec(**given), self.store).spec
        return self.store.campaigns.create(accept_spec(spec)).id

    def finish(self, number: int) -> int:
        spec = self.store.campaigns.move(number, CampaignState.RUNNING).spec
        method = plugins.load(plugins.METHODS, spec.method)
        context = learner_context(self.store.campaigns.get(number), self.store)
        rounds = Rounds(method(context, method.Settings(**spec.settings)), 0, spec.episodes)
        engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        for result in run_in_process(rounds, engine):
            self.store.episodes.commit(number, [Delivery(result, "w")])
        self.store.checkpoints.save(number, rounds.checkpoint())
        self.store.campaigns.move(number, CampaignState.DONE)
        return number

    def run(self, **fields) -> int:
        return self.finish(self.create(**fields))

    def chains(self, **fields) -> int:
        settings = {"campaign": self.before, "chains": CHAINS}
        return self.create(
            **{"method": "chains", "episodes": EPISODES, "settings": settings} | fields
        )
