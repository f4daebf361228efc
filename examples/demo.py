"""`make demo`: four searches for failures, their modes, the replay of these, and the bill.

Starts a service on ./eigenfail-data as `eigenfail up` does, asks it over REST, and stops it again.
"""

import sys
import time
from pathlib import Path

from msgspec import structs

from eigenfail.cli.analyze import prove_analysis
from eigenfail.cli.render import follow, make_console
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.client import Client
from eigenfail.errors import EigenfailError
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.processes import interruptible
from eigenfail.hosting.service import Plan, local_service
from eigenfail.presentation.analyses import count_reproductions, describe_modes
from eigenfail.presentation.campaigns import tabulate_results
from eigenfail.presentation.terminal import render
from eigenfail.values.analysis import AnalysisSettings, AnalysisState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.summary import Summary

HERE = Path(__file__).parent
EPISODES = {"monte_carlo": 400, "ast": 400, "difs": 400, "held": 400}
ANALYSED = "ast"
SCALE = 0.75
"""Share of the noise: little enough that noise which is not learnt finds next to nothing."""
# The defaults, which `eigenfail analyze 2 --prove`, the dashboard and the client have, too.
ANALYSIS = AnalysisSettings()


def read_specs() -> dict[str, CampaignSpec]:
    """The campaigns of the demo, by method."""
    specs = {
        method: reduce_noise(read_spec(HERE / f"{method}.toml", episodes=episodes))
        for method, episodes in EPISODES.items()
    }
    for spec in specs.values():
        check_plugins(spec)
    return specs


def reduce_noise(spec: CampaignSpec) -> CampaignSpec:
    """The campaign with less noise."""
    return structs.replace(spec, disturbance=structs.replace(spec.disturbance, scale=SCALE))


def search(client: Client, spec: CampaignSpec) -> Summary:
    """Run a campaign to its end."""
    campaign = client.campaigns.create(spec)
    follow(client, campaign.id)
    return client.campaigns.summary(campaign.id)


def explain(client: Client, campaign: int) -> None:
    """Group the failures of a campaign into modes, and prove these by replay."""
    screen = make_console()
    analysis = client.analyses.wait(client.analyses.create(campaign, ANALYSIS).id)
    if analysis.state is AnalysisState.FAILED or analysis.result is None:
        screen.print(f"The failures of campaign {campaign} were not analysed: {analysis.problem}")
        return
    screen.print(f"\nFailure modes of campaign {campaign}; disturbances in sigma:")
    screen.print(render(*describe_modes(campaign, analysis.result), *analysis.result.notes))
    proof = prove_analysis(client, analysis.id, ())
    screen.print(render(*count_reproductions(proof, analysis.result.cluster_noun)))


def demo(client: Client) -> None:
    """The whole way: search, compare, explain."""
    summaries = {method: search(client, spec) for method, spec in read_specs().items()}
    make_console().print(render(tabulate_results(summaries.values())))
    explain(client, summaries[ANALYSED].campaign)


def main() -> int:
    """Run the demo; the exit code says whether it went well."""
    began = time.monotonic()
    try:
        with interruptible(), local_service(Plan(DEFAULT_DATA, port=0)) as service:
            print(f"The service runs at {service.address.url}.", flush=True)
            with Client(service.address.url) as client:
                demo(client)
    except EigenfailError as error:
        print(f"eigenfail: {error}", file=sys.stderr)
        return error.exit_code
    print(f"\nDone in {time.monotonic() - began:.0f} s; nothing was left running.")
    print("To look at these results: .venv/bin/eigenfail up prints the address to open.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
