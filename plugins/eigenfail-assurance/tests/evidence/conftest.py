"""Records of campaigns that were never run, with any outcomes."""

from hashlib import sha256

import pytest
from msgspec.structs import replace

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.episode import episode_seed
from eigenfail_assurance.evidence.counting import CountedCampaign
from eigenfail_assurance.evidence.question import Claim, EvidenceQuestion, SearchSolution
from eigenfail_assurance.evidence.records import (
    COLUMNS,
    CampaignFacts,
    CampaignRecord,
    EvidenceRecords,
    SolutionInput,
    hash_episodes,
    read_episodes,
)

WORDS = {"s": "safe", "c": "collision", "e": "errored"}


def make_record(
    outcomes, number=1, *, method="monte_carlo", seed=3, state="done", unresolved=0, **fields
):
    """Return the record of a campaign whose episodes ended like this, a letter for each."""
    rows = [",".join(COLUMNS)]
    for index, letter in enumerate(outcomes):
        digest = sha256(f"{number} {index} {letter}".encode()).hexdigest()
        rows.append(f"{index},{episode_seed(seed, index)},prior,{WORDS[letter]},9,1.5,,{digest}")
    table = ("\r\n".join(rows) + "\r\n").encode()
    stop = fields.pop("stop", StopRules())
    spec = CampaignSpec(
        name=f"made up {number}",
        method=method,
        episodes=len(outcomes),
        seed=seed,
        planner="idm",
        simulator="point_mass",
        stop=stop,
    )
    counts = Counts(
        planned=len(outcomes),
        completed=len(outcomes) - outcomes.count("e"),
        failures=outcomes.count("c"),
        errored=outcomes.count("e"),
    )
    campaign = Campaign(
        id=number, spec=spec, state=CampaignState(state), counts=counts, created_ms=0, **fields
    )
    if state == "done":
        campaign = replace(campaign, digest=hash_episodes(read_episodes(table, "made up")))
    return CampaignRecord(
        facts=CampaignFacts(campaign=campaign, unresolved=unresolved), table=table
    )


@pytest.fixture
def make():
    """Makes the record of a campaign."""
    return make_record


@pytest.fixture
def count():
    """Makes campaigns with their episodes, by id, and the input of a solution that names them."""

    def count_records(*records):
        counted = {each.campaign.id: CountedCampaign(each) for each in records}
        return SolutionInput(campaigns=(tuple(counted),)), counted

    return count_records


@pytest.fixture
def small():
    """A question with one solution, and the records behind it."""
    claim = Claim(
        text="A search <finds> & nothing.",
        argument="By a search.",
        solutions=(SearchSolution(campaigns=(1,)),),
    )
    question = EvidenceQuestion(name="Small", claim=claim)
    given = SolutionInput(campaigns=((1,),))
    return question, EvidenceRecords({1: make_record("ssss")}, (given,))
