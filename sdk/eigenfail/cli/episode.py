"""`eigenfail episode`: list, show, export, replay, explain and shrink episodes."""

from functools import partial
from math import inf
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.cli import completion, options
from eigenfail.cli.answers import prints_answer
from eigenfail.cli.connection import connect_to
from eigenfail.cli.render import CommandResult, first_rows, follow, judge, to_json
from eigenfail.client import Client
from eigenfail.client.episodes import ExportFormat, ExportRequest
from eigenfail.contracts.recording import KNOWN, EgoControl
from eigenfail.errors import InvalidValue, NoisePruned, NotFound
from eigenfail.explanations import StepWindow, build_explanation, describe_unsteadiness
from eigenfail.filters import parse_fields
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.hosting.processes import interruptible
from eigenfail.presentation import episodes
from eigenfail.presentation.tables import FactTable
from eigenfail.progress import announce
from eigenfail.replays import explain_episode, redraw_episode, replay_episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail.values.failures import FAILURE_ORDERS, MOST_SEVERE_FIRST
from eigenfail.values.operations import Versions
from eigenfail.values.proof import Replayed
from eigenfail.versions import CODE, differences, fingerprint_plugins, select_code, versions
from eigenfail.wire.http import SHRINK_WITHIN
from eigenfail.worlds import drawn_for, find_robustness_unit, placed_for

DIFFERENT = 1

ALL_STEPS = StepWindow(0.0, inf, 1)
WithSteps = Annotated[
    bool, typer.Option("--steps", help="Also show each step, as --every, --from and --to do.")
]
Every = Annotated[int, typer.Option(min=1, help="Show only every N-th step.")]
From = Annotated[float, typer.Option("--from", help="Show steps from this time on. [s]")]
To = Annotated[
    float, typer.Option("--to", show_default="the end", help="Show steps up to this time. [s]")
]
Replays = Annotated[int, typer.Option("--episodes", min=1, help="Budget of replays.")]


@prints_answer()
def replay(client: Client, episode: options.EpisodeId) -> CommandResult:
    """Replay a stored episode on this machine; exit with 1 if the result differs.

    Noise that was pruned is drawn again if it follows from the episode's seed.
    """
    campaign, index = options.parse_episode_id(episode)
    spec = client.campaigns.get(campaign).spec
    try:
        stored = client.episodes.get(campaign, index)
    except NoisePruned:
        row = next(iter(client.episodes.list(campaign, filter=f"index = {index}")))
        replayed = redraw_episode(spec, row)
    else:
        replayed = replay_episode(spec, stored)
    # Versions are compared only if results differ: most replays need no second question.
    if not replayed.same:
        differing = _list_differences(client, spec, campaign, index)
        replayed = replace(replayed, differing=differing)
    facts = _list_replay_facts(episode, replayed)
    return CommandResult(replayed, facts, exit_code=0 if replayed.same else DIFFERENT)


@prints_answer()
def explain(
    client: Client,
    episode: options.EpisodeId,
    steps: WithSteps = False,
    every: Every = ALL_STEPS.every,
    since_s: From = ALL_STEPS.since_s,
    until_s: To = ALL_STEPS.until_s,
) -> CommandResult:
    """Replay a stored episode, and print what happened, from the planner's own account.

    If the episode failed, the command also runs it without noise, and says whether noise is the
    cause.

    With --steps, --every, --from or --to, what the planner believed and decided in these steps
    follows. Exits with 1 if the run differs from the stored one.
    """
    window = StepWindow(since_s, until_s, every)
    with_steps = steps or window != ALL_STEPS
    campaign, index = options.parse_episode_id(episode)
    stored = client.episodes.get(campaign, index)
    spec = client.campaigns.get(campaign).spec
    with announce(f"Running episode {episode} again"):
        replayed, explained = explain_episode(spec, stored)
    explanation = build_explanation(episode, spec.planner, replayed, explained, window)
    return CommandResult(
        explanation,
        *episodes.describe_explanation(explanation, with_steps=with_steps),
        exit_code=0 if replayed.same else DIFFERENT,
    )


@prints_answer()
def shrink(
    client: Client, episode: options.EpisodeId, replays: Replays = SHRINK_WITHIN
) -> CommandResult:
    """Reduce the noise of a failure as long as it still fails, by a campaign of replays."""
    campaign, index = options.parse_episode_id(episode)
    with interruptible():
        ended = follow(client, client.campaigns.shrink(campaign, index, replays).id)
        judge(ended, gate=False)
        found = client.campaigns.minimal(ended.id)
    return CommandResult(found, *episodes.describe_minimal_failure(found))


def _list_differences(
    client: Client, spec: CampaignSpec, campaign: int, index: int
) -> tuple[str, ...] | None:
    """Return the versions that differ from those of the run; None if those are not known."""
    try:
        then = client.episodes.worker(campaign, index).versions
    except NotFound:
        return None
    # Code counts where the campaign needs it and the worker has recorded it.
    code = {f"{CODE}{package}" for package in select_code(then, spec)}
    now = versions() | fingerprint_plugins()
    return differences(_drop_other_code(then, code), _drop_other_code(now, code))


def _drop_other_code(found: Versions, code: set[str]) -> Versions:
    """Return versions without the fingerprints of code that are not named."""
    return {
        name: version
        for name, version in found.items()
        if not name.startswith(CODE) or name in code
    }


def _list_replay_facts(episode: str, replayed: Replayed) -> FactTable:
    """Return how a replay compares with the stored episode."""
    verdict = (
        "the same, bit for bit" if replayed.same else f"DIFFERENT: {_explain_difference(replayed)}"
    )
    rows = (
        ("episode", episode),
        ("stored", f"{replayed.stored_outcome.word} {replayed.stored_digest}"),
        ("replayed", f"{replayed.outcome.word} {replayed.digest}"),
        ("result", verdict),
    )
    return FactTable("Replay", rows)


def _explain_difference(replayed: Replayed) -> str:
    """Possible causes of a difference."""
    if replayed.unsteady is not None:
        return describe_unsteadiness(replayed.unsteady)
    if replayed.differing is None:
        return "the versions of the original run are not known"
    return "; ".join(replayed.differing) or "the versions are the same, something is left to chance"


app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Show, export, replay and explain episodes."
)


def _parse_outcome(word: str) -> Outcome:
    """Return the outcome of a word; "failed", which the API says for "errored", is accepted too."""
    try:
        return Outcome(word)
    except ValueError:
        known = ", ".join(each.word for each in Outcome)
        raise typer.BadParameter(f"'{word}' is not a valid outcome. Outcomes: {known}.") from None


OUTCOMES = "|".join(each.word for each in Outcome)
OnlyOutcome = Annotated[
    Outcome | None,
    typer.Option(
        parser=_parse_outcome, metavar=f"<{OUTCOMES}>", help="Only episodes with this outcome."
    ),
]
Filter = Annotated[
    str,
    typer.Option("--filter", help='Conditions, such as "severity > 80 and min_ttc_s < 1.5".'),
]
Sort = Annotated[str, typer.Option(help="A column, or -column for the largest first.")]
Fields = Annotated[
    str, typer.Option(show_default="all", help="Only these columns, separated by commas.")
]
Output = Annotated[
    Path, typer.Option("--output", "-o", help="File to write; its suffix chooses the format.")
]
FORMATS = "|".join((*ExportFormat, *KNOWN))
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar=f"<{FORMATS}>",
        show_default="by the file's name",
        help="Format of the file: csv, ndjson or parquet of a campaign; openscenario, mcap, gif "
        "or another format of a plug-in of one episode.",
    ),
]
Exported = Annotated[
    str,
    typer.Argument(
        metavar="CAMPAIGN[/INDEX]", help="Id of the campaign, or one episode of it, such as 3/17."
    ),
]
Ego = Annotated[
    EgoControl | None,
    typer.Option(
        "--ego",
        show_default="recorded",
        help="Of OpenSCENARIO: let the ego repeat its course, or leave it to a controller.",
    ),
]
Noise = Annotated[
    bool, typer.Option("--noise", help="Include the noise of each episode; Parquet only.")
]


@app.command("list")
@prints_answer()
def list_episodes(
    client: Client,
    campaign: options.CampaignId,
    outcome: OnlyOutcome = None,
    conditions: Filter = "",
    sort: Sort = "index",
    fields: Fields = "",
    limit: options.Limit = 20,
) -> CommandResult:
    """List the episodes of a campaign."""
    if columns := parse_fields(fields):
        picked = client.episodes.list(
            campaign, outcome, filter=conditions, sort=sort, fields=columns
        )
        return first_rows(picked, limit, partial(episodes.tabulate_fields, columns))
    found = client.episodes.list(campaign, outcome, filter=conditions, sort=sort)
    unit = find_robustness_unit(client.campaigns.get(campaign).spec)
    return first_rows(found, limit, partial(episodes.tabulate_episodes, unit=unit))


@app.command()
def export(
    context: typer.Context,
    exported: Exported,
    output: Output,
    url: options.Url = DEFAULT_URL,
    form: Format = None,
    conditions: Filter = "",
    sort: Sort = "index",
    fields: Fields = "",
    noise: Noise = False,
    ego: Ego = None,
    as_json: options.AsJson = False,
) -> None:
    """Write episodes of a campaign as a table, or one episode for other tools, to a file.

    A campaign is written as CSV, NDJSON or Parquet; an episode as OpenSCENARIO, MCAP or GIF.
    """
    wanted = ExportRequest(conditions, sort, parse_fields(fields), noise)
    with interruptible(), connect_to(context, url) as client, announce(f"Writing {output}"):
        if "/" in exported:
            _refuse_options(wanted)
            episode = options.parse_episode_id(exported)
            client.episodes.export_recording(*episode, output, form, ego or EgoControl.RECORDED)
        else:
            _refuse_ego(ego)
            asked = msgspec.structs.asdict(wanted)
            client.episodes.export(_parse_campaign_id(exported), output, form, **asked)
    if as_json:
        typer.echo(to_json({"file": str(output), "size_bytes": output.stat().st_size}))
        return
    typer.echo(f"Wrote {output}.", err=True)


def _refuse_options(wanted: ExportRequest) -> None:
    """Refuse options that choose episodes or columns if one episode is named."""
    usual = msgspec.structs.asdict(ExportRequest())
    for name, given in msgspec.structs.asdict(wanted).items():
        if given != usual[name]:
            problem = "It applies to the episodes of a campaign, not to one episode."
            raise InvalidValue(f"--{name}", problem, "Leave it out.")


def _refuse_ego(ego: EgoControl | None) -> None:
    if ego is not None:
        problem = "It applies to one episode, not to a campaign."
        raise InvalidValue("--ego", problem, "Name an episode as CAMPAIGN/INDEX.")


def _parse_campaign_id(text: str) -> int:
    if not text.isdecimal() or not int(text):
        problem = f"'{text}' is neither a campaign, such as 3, nor an episode, such as 3/17."
        raise InvalidValue("campaign", problem)
    return int(text)


@app.command("show")
@prints_answer()
def show_episode(client: Client, episode: options.EpisodeId) -> CommandResult:
    """Show one episode; with --json its noise and scene, too."""
    campaign, index = options.parse_episode_id(episode)
    found, spec = client.episodes.get(campaign, index), client.campaigns.get(campaign).spec
    drawn_here = drawn_for(spec, found.seed) | placed_for(spec, found.noise)
    facts = episodes.list_episode_facts(f"{campaign}/{found.index}", found, spec, drawn_here)
    return CommandResult(found, facts)


for page in (replay, explain, shrink):
    app.command()(page)

OfPlanner = Annotated[
    str | None,
    typer.Option(
        help="Only failures of this planner.",
        autocompletion=completion.complete_plugins(plugins.PLANNERS),
    ),
]
OfPlannerVersion = Annotated[
    str | None, typer.Option(help="Only failures of this version of a planner.")
]
OfMethod = Annotated[
    str | None,
    typer.Option(
        help="Only failures that this method found.",
        autocompletion=completion.complete_plugins(plugins.METHODS),
    ),
]
FailureSort = Annotated[str, typer.Option(help=f"{' or '.join(FAILURE_ORDERS)}.")]
OfArchived = Annotated[
    bool, typer.Option("--archived", help="List failures of archived campaigns, too.")
]


@app.command("failures")
@prints_answer()
def list_failures(
    client: Client,
    project: options.Project = None,
    planner: OfPlanner = None,
    planner_version: OfPlannerVersion = None,
    method: OfMethod = None,
    sort: FailureSort = MOST_SEVERE_FIRST,
    archived: OfArchived = False,
    limit: options.Limit = 20,
) -> CommandResult:
    """List the collisions of all campaigns, the most severe first.

    Campaigns that repeat earlier failures are left out unless --method names theirs.
    """
    found = client.episodes.list_failures(
        project=project,
        planner=planner,
        planner_version=planner_version,
        method=method,
        sort=sort,
        archived=archived,
    )
    return first_rows(found, limit, episodes.tabulate_failures)
