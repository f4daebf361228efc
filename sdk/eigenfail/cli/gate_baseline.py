"""The campaigns of a gate's baseline, however it is named."""

import re
from collections.abc import Iterable, Mapping

from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.gate.report import Gate
from eigenfail.gate.versions import counterpart, run_name
from eigenfail.suites import Suite
from eigenfail.values import Campaign
from eigenfail.values.suite import suite_of

IDS = re.compile(r"[1-9]\d*(,[1-9]\d*)*")
FILE = ".toml"

Found = Mapping[str, Campaign]


def find_baseline(client: Client, suite: Suite, gate: Gate) -> Found:
    """The campaign of each member of the suite, by the member's name; those that there are.

    The baseline may be named by the file of a suite that was run, by campaigns' ids, by the name of
    a suite or of a run, or by the version of one. If it is not named, it is this run itself.

    Raises:
        NotFound: no such campaign.
        InvalidValue: no such file, more than one campaign that could be a member's, or the very run
            that is to be judged.
    """
    run = gate.baseline
    if run in {gate.run, gate.version}:
        problem = f"'{run}' is the version under test itself."
        raise InvalidValue("baseline", problem, "Give another --planner-version, or no --baseline.")
    if not run:
        return of_file(client, suite, suite)
    if run.endswith(FILE):
        return of_file(client, suite, Suite.read(run))
    if IDS.fullmatch(run):
        return of_ids(client, suite, map(int, run.split(",")))
    return of_run(client, suite, run) or of_run(client, suite, run_name(gate.suite, run))


def of_file(client: Client, suite: Suite, before: Suite) -> Found:
    """The campaigns of a suite with exactly this content."""
    wanted = {member.name for member in suite.members}
    pairs = zip(before.members, client.suites.find(before), strict=True)
    return {each.name: found for each, found in pairs if found and each.name in wanted}


def of_ids(client: Client, suite: Suite, ids: Iterable[int]) -> Found:
    """Campaigns that were named one by one."""
    campaigns = [client.campaigns.get(campaign) for campaign in ids]
    found = {member.name: counterpart(member, campaigns) for member in suite.members}
    return {name: campaign for name, campaign in found.items() if campaign}


def of_run(client: Client, suite: Suite, run: str) -> Found:
    """The newest campaigns of a run's name."""
    wanted = {f"{run}: {member.name}": member.name for member in suite.members}
    found: dict[str, Campaign] = {}
    for campaign in client.campaigns.list(suite=suite_of(next(iter(wanted)))):
        if name := wanted.pop(campaign.spec.name, None):
            found[name] = campaign
        if not wanted:
            break
    return found
