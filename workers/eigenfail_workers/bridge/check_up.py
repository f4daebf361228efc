"""Every check of a bridge, as `eigenfail doctor --bridge` shows it."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing

from eigenfail.bridges import Plain, check_address
from eigenfail.cli.checkups import SKIPPED, Checked, Verdict
from eigenfail.errors import EigenfailError, EpisodeError
from eigenfail.testing.simulation import SEED
from eigenfail_workers.bridge.checks import CHECKS, Check, counts_each_step, what_breaks
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import Planner, Scenario, Start, Welcome
from eigenfail_workers.bridge.pace import pace_of

HELLO = "says hello"
PACE = "keeps pace"


def check_up(address: str) -> list[Checked]:
    """What holds, and what does not: all checks with the scenario and the planner named first.

    Of the others it is asked that each runs an episode to its end.

    Raises:
        InvalidValue: the address is none, or one that nobody may connect to.
    """
    try:
        with closing(Connection(check_address(address))) as connection:
            welcome = connection.welcome
    except EpisodeError as error:
        rest = (Checked(address, named(check), Verdict.SKIPPED, SKIPPED) for check in CHECKS)
        return [Checked(address, HELLO, Verdict.BROKEN, str(error)), *rest]
    return [*introduction(address, welcome), *examined(address, welcome)]


def examined(address: str, welcome: Welcome) -> Iterator[Checked]:
    """How fast it is, and one check after the other, unless it is gone for good."""
    rest = iter(questions(welcome))
    pace = keeps_pace(address, start_of(welcome.scenarios[0], welcome.planners[0]))
    yield pace
    if pace.verdict is not Verdict.BROKEN or answers(address):
        for start, check in rest:
            checked = asked(address, start, check)
            yield checked
            if checked.verdict is Verdict.BROKEN and not answers(address):
                break
    yield from skipped(rest)


def keeps_pace(address: str, start: Start) -> Checked:
    """What a step takes."""
    what = f"{start.scenario}, {start.planner}"
    try:
        with closing(Connection(address)) as connection:
            found = pace_of(connection, start)
            verdict, said = found.verdict(start.steps, connection.patience)
    except EigenfailError as error:
        verdict, said = Verdict.BROKEN, str(error)
    return Checked(what, PACE, verdict, said)


def answers(address: str) -> bool:
    """Whether there is still a bridge."""
    try:
        Connection(address).close()
    except EpisodeError:
        return False
    return True


def skipped(rest: Iterable[tuple[Start, Check]]) -> Iterator[Checked]:
    """What is not asked any more."""
    for start, check in rest:
        what = f"{start.scenario}, {start.planner}"
        yield Checked(what, named(check), Verdict.SKIPPED, SKIPPED)


def questions(welcome: Welcome) -> Iterator[tuple[Start, Check]]:
    """What is asked, and with which scenario and planner."""
    scenario, *scenarios = welcome.scenarios
    planner, *planners = welcome.planners
    for check in CHECKS:
        yield start_of(scenario, planner), check
    for each in scenarios:
        yield start_of(each, planner), counts_each_step
    for other in planners:
        yield start_of(scenario, other), counts_each_step


def start_of(scenario: Scenario, planner: Planner) -> Start:
    """An episode with all defaults."""
    return Start(0, SEED, scenario.name, {}, planner.name, {}, scenario.steps)


def asked(address: str, start: Start, check: Check) -> Checked:
    """A check, and what came of it."""
    broken = what_breaks(address, start, check)
    promise = (check.__doc__ or "").partition("\n")[0]
    verdict = Verdict.BROKEN if broken else Verdict.PASSED
    return Checked(f"{start.scenario}, {start.planner}", named(check), verdict, broken or promise)


def named(check: Check) -> str:
    """A check as people read it."""
    return check.__name__.replace("_", " ")


def introduction(address: str, welcome: Welcome) -> Iterator[Checked]:
    """What a bridge says of itself; with the defaults of its parameters and settings."""
    said = f"{welcome.name} {welcome.version}: up to {welcome.slots} episodes side by side."
    yield Checked(address, HELLO, Verdict.PASSED, said)
    for each in welcome.scenarios:
        known = {"steps": each.steps, "dt_s": each.dt_s, **(each.parameters or {})}
        yield Checked(each.name, "scenario", Verdict.PASSED, told(known))
    for planner in welcome.planners:
        yield Checked(planner.name, "planner", Verdict.PASSED, told(planner.settings or {}))


def told(defaults: Mapping[str, Plain]) -> str:
    """Names and defaults."""
    return ", ".join(f"{name} = {value}" for name, value in defaults.items())
