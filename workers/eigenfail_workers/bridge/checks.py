"""The checks of a bridge behind `eigenfail doctor --bridge`: protocol, contract and speed."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from itertools import pairwise
from time import perf_counter

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import Plain, check_address, find_scenario
from eigenfail.cli.plugin_checks import SKIPPED, CheckResult, CheckVerdict
from eigenfail.errors import EigenfailError, EpisodeError, SimulatorError, suggest_name
from eigenfail.testing import expect
from eigenfail.testing.simulation import (
    SEED,
    calm,
    counts_steps,
    course,
    ends_at_a_collision,
    repeats_itself,
    shows_finite_numbers,
    starts_at_step_zero,
    wave,
)
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import (
    ALL_CHANNELS,
    EVENT,
    EVERY,
    LATENCY,
    VEHICLE,
    Channel,
    find_quantity,
    split_name,
)
from eigenfail.values.disturbance import POSITION
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail.values.scene import Observation
from eigenfail.values.shapes import Row
from eigenfail_workers.bridge import episode, messages
from eigenfail_workers.bridge.connection import BridgeTimeouts, Connection, SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.measures.encounters import end_at_contact
from eigenfail_workers.perception import SensorErrors

HELLO = "says hello"
PACE = "keeps pace"
EPISODE = "runs an episode of the campaign"
MAX_BESIDE = 7
"""Most episodes that the checks run side by side: more slots would only take longer."""

Check = Callable[[Connection, messages.SlotStart], None]


class BridgeSimulation:
    """One slot of a bridge, stepped by itself. Implements `Simulation` for the checks.

    Args:
        connection: connection that nothing else uses at the same time; it stays open.
        start: episode to begin; each reset replaces its seed, and `channels` its channels.
        channels: the channels, in the order of the disturbances. By default, disturbances have
            both channels of the position, and channels that the bridge does not offer are left out.
    """

    def __init__(
        self,
        connection: Connection,
        start: messages.SlotStart,
        channels: tuple[Channel, ...] | None = None,
    ) -> None:
        self._connection = connection
        self._is_position = channels is None
        self._channels = list_position(connection.welcome) if channels is None else channels
        self._start = replace(start, channels=episode.list_injected(self._channels))
        self.dt_s = find_scenario(connection.welcome.offer, start.scenario).dt_s
        self.steps = start.steps
        self._reader = episode.ObservationReader(self._channels, self.dt_s)
        self._now: Observation | None = None
        self._closed = False

    def reset(self, seed: int) -> Observation:
        """Begin an episode; see `Simulation.reset`."""
        if self._closed:
            raise SimulatorError("The simulation is closed.", "Open another one.")
        # Forgotten first: if the reset fails, a step must not go on with the episode before.
        self._now = None
        (seen,) = _reset(self._connection, replace(self._start, seed=seed))
        self._reader = episode.ObservationReader(self._channels, self.dt_s)
        self._now = self._reader.read(seen, ())
        return self._now

    def step(self, disturbance: Row) -> Observation:
        """Disturb each channel and step; see `Simulation.step`."""
        now = self._now
        if now is None or now.ended or self._closed:
            raise SimulatorError("There is no episode to go on with.", "Reset the simulation.")
        self._now = None
        if self._is_position:
            disturbance = select_components(self._channels, disturbance)
        (seen,) = _step(
            self._connection, episode.make_step(self._start.slot, self._channels, disturbance)
        )
        self._now = self._reader.read(seen, disturbance)
        return self._now

    def close(self) -> None:
        """Refuse further requests."""
        self._closed = True
        self._now = None


def list_position(welcome: messages.BridgeWelcome) -> tuple[Channel, ...]:
    """Return the channels of the position of the nearest vehicle that a bridge offers."""
    return tuple(channel for channel in POSITION if channel.name in welcome.offer.channels)


def select_components(channels: tuple[Channel, ...], disturbance: Row) -> Row:
    """Return the components of a position's disturbance that belong to the given channels."""
    pairs = zip(POSITION, disturbance, strict=True)
    return tuple(each for channel, each in pairs if channel in channels)


def _reset(
    connection: Connection, *starts: messages.SlotStart
) -> tuple[messages.SlotObservation, ...]:
    if connection.welcome.seed_text:
        starts = tuple(replace(start, seed=str(start.seed)) for start in starts)
    return _request(
        connection, messages.ResetRequest(connection.session, connection.next_id(), starts)
    )


def _step(
    connection: Connection, *steps: messages.SlotStep
) -> tuple[messages.SlotObservation, ...]:
    return _request(
        connection, messages.StepRequest(connection.session, connection.next_id(), steps)
    )


def _request(
    connection: Connection, request: messages.ResetRequest | messages.StepRequest
) -> tuple[messages.SlotObservation, ...]:
    """Send a request while none is pending, and return the observations of its answer."""
    connection.send(request)
    answer = connection.receive(connection.timeouts.answer_s)
    return messages.match_answer(answer, request.id, len(request.slots))


def _adapt(check: Callable[..., None]) -> Check:
    """Return a check of bridges from a check of simulations that needs no planner."""

    def run(connection: Connection, start: messages.SlotStart) -> None:
        check(lambda _planner: BridgeSimulation(connection, start))

    # The report prints the name of a check, and the first line of its docstring.
    run.__name__, run.__doc__ = check.__name__, check.__doc__
    return run


def reports_each_collision(connection: Connection, start: messages.SlotStart) -> None:
    """Collisions are reported when footprints meet, within a step too, and only then."""
    with closing(BridgeSimulation(connection, start)) as simulation:
        seen = course(simulation)
        before: Observation | None = None
        for now in seen:
            shown = end_at_contact(before, now, simulation.dt_s)
            said = (
                f"In step {now.step} the ego touches a vehicle, and no collision is reported. "
                f"Campaigns end the episode there as a collision."
            )
            expect(now.collided or not shown.collided, said)
            before = now


def disturbs_the_nearest(connection: Connection, start: messages.SlotStart) -> None:
    """A disturbance moves the nearest vehicle as the planner perceives it."""
    if len(list_position(connection.welcome)) < len(POSITION):
        return  # `disturbs_each_channel` tries what the bridge offers in their place.
    with closing(BridgeSimulation(connection, start)) as simulation:
        disturbed, undisturbed = course(simulation, wave), course(simulation, calm)
    # The worker's own arithmetic: the position must be equal to the last bit, or replays differ.
    errors = SensorErrors(POSITION)
    for before, after in pairwise(disturbed):
        due = errors.perceive(before, simulation.dt_s, wave(after.step))[1]
        said = f"Step {after.step} reports {after.perceived} as the perceived position, not {due}."
        expect(after.perceived == due, said)
    moved = [each.ego for each in disturbed] != [each.ego for each in undisturbed]
    expect(moved, "Disturbances of metres change nothing: the planner is not shown them.")


def keeps_slots_apart(connection: Connection, start: messages.SlotStart) -> None:
    """Episodes side by side in one request equal the same episodes alone, bit for bit."""
    beside = min(connection.welcome.slots, MAX_BESIDE)
    seeds = [SEED + slot for slot in range(beside)]
    with closing(BridgeSimulation(connection, start)) as simulation:
        alone = [course(simulation, seed=seed) for seed in seeds]
    together = _run_side_by_side(connection, start, seeds)
    expect(together == alone, f"Of {beside} episodes side by side, some are others than alone.")


def _run_side_by_side(
    connection: Connection, start: messages.SlotStart, seeds: list[int]
) -> list[list[Observation]]:
    """Run an episode for each seed in a separate slot, with all steps in one request."""
    starts = (replace(start, slot=slot, seed=seed) for slot, seed in enumerate(seeds))
    welcome = connection.welcome
    dt_s = find_scenario(welcome.offer, start.scenario).dt_s
    channels = list_position(welcome)
    readers = [episode.ObservationReader(channels, dt_s) for _ in seeds]
    shown = zip(readers, _reset(connection, *starts), strict=True)
    courses = [[reader.read(seen, ())] for reader, seen in shown]
    while running := [slot for slot, course in enumerate(courses) if not course[-1].ended]:
        waves = {slot: select_components(channels, wave(len(courses[slot]))) for slot in running}
        steps = (episode.make_step(slot, channels, waves[slot]) for slot in running)
        for slot, seen in zip(running, _step(connection, *steps), strict=True):
            courses[slot].append(readers[slot].read(seen, waves[slot]))
    return courses


def refuses_what_is_over(connection: Connection, start: messages.SlotStart) -> None:
    """A step before a reset or after the end is answered with a fault."""
    channels = list_position(connection.welcome)
    step = episode.make_step(start.slot, channels, (0.0,) * len(channels))
    (seen,) = _step(connection, step)
    # Nothing was reset yet on this connection: an answer could only be made up.
    expect(seen.fault is not None, "A step before any reset must be answered with a fault.")
    with closing(BridgeSimulation(connection, start)) as simulation:
        course(simulation)
    (seen,) = _step(connection, step)
    expect(seen.fault is not None, "A step after the end must be answered with a fault.")


def refuses_unknown_names(connection: Connection, start: messages.SlotStart) -> None:
    """An unknown scenario is a fault of the input, and the next episode begins as usual."""
    unknown = replace(start, scenario="no such scenario", parameters={}, settings={})
    (seen,) = _reset(connection, unknown)
    said = "A scenario that it does not have must be answered with the fault 'input'."
    expect(seen.fault == "input", said)
    with closing(BridgeSimulation(connection, start)) as simulation:
        simulation.reset(SEED)


def offers_known_channels(connection: Connection, _start: messages.SlotStart) -> None:
    """Each channel that the bridge offers is one that campaigns can name."""
    for name in connection.welcome.offer.channels:
        numbered, quantity = split_name(name).vehicle is not None, split_name(name).quantity
        known = name in ALL_CHANNELS or (numbered and f"{EVERY}.{quantity}" in ALL_CHANNELS)
        expect(known, f"'{name}' is no channel. {suggest_name(name, ALL_CHANNELS)}")


def disturbs_each_channel(connection: Connection, start: messages.SlotStart) -> None:
    """With each channel that the bridge offers disturbed, episodes end, and repeat themselves."""
    for name in connection.welcome.offer.channels:
        target, quantity = split_name(name)
        one = f"{VEHICLE}1.{quantity}" if target == EVERY else name
        channel = Channel(one).filled()
        with closing(BridgeSimulation(connection, start, (channel,))) as simulation:
            first, again = (course(simulation, _make_wave(channel)) for _ in range(2))
        # By text: a position that is not shown is NaN, which is unlike itself.
        expect(repr(first) == repr(again), f"With '{one}' disturbed, the second episode differs.")


def _make_wave(channel: Channel) -> Callable[[int], Row]:
    """Return disturbances of one channel: for events on and off, for a delay always the same."""
    if channel.kind is EVENT:
        return lambda step: (float(step % 10 < 3),)
    if channel.kind is LATENCY:
        return lambda _step: (0.2,)
    amplitude = find_quantity(channel.name).sigma or 1.0
    return lambda step: (amplitude * wave(step)[0],)


def refuses_unknown_channels(connection: Connection, start: messages.SlotStart) -> None:
    """An unknown channel is a fault of its slot, and the next episode begins as usual."""
    unknown = replace(start, channels=(messages.InjectedChannel("no such channel"),))
    (seen,) = _reset(connection, unknown)
    expect(seen.fault is not None, "A channel that it does not offer must be a fault.")
    with closing(BridgeSimulation(connection, start)) as simulation:
        simulation.reset(SEED)


counts_each_step = _adapt(counts_steps)

CHECKS: tuple[Check, ...] = (
    _adapt(starts_at_step_zero),
    counts_each_step,
    _adapt(ends_at_a_collision),
    reports_each_collision,
    _adapt(shows_finite_numbers),
    _adapt(repeats_itself),
    disturbs_the_nearest,
    keeps_slots_apart,
    refuses_what_is_over,
    refuses_unknown_names,
    offers_known_channels,
    disturbs_each_channel,
    refuses_unknown_channels,
)


class BridgePace(msgspec.Struct, frozen=True):
    """Wall time of a step. [s]

    Attributes:
        dt_s: duration of a step in the simulated world.
        alone_s: wall time for one episode, with its reset divided among the steps.
        together_s: wall time for all of several episodes side by side.
        beside: number of episodes side by side.
    """

    dt_s: float
    alone_s: float
    together_s: float
    beside: int

    def __str__(self) -> str:
        """Return the measurement as a sentence."""
        return (
            f"{1e3 * self.alone_s:.3g} ms a step, {self.dt_s / self.alone_s:.3g} × real time; "
            f"{1e3 * self.together_s:.3g} ms for {self.beside} side by side."
        )

    def judge(self, steps: int, timeouts: BridgeTimeouts) -> tuple[CheckVerdict, str]:
        """Return whether the bridge is fast enough for campaigns, and why."""
        episode_s = steps * self.alone_s
        if episode_s > timeouts.episode_s:
            said = f"An episode takes {episode_s:.3g} s, and is given up after"
            return CheckVerdict.BROKEN, f"{self} {said} {timeouts.episode_s:g} s. {timeouts.remedy}"
        if self.alone_s > self.dt_s:
            return (
                CheckVerdict.SLOW,
                f"{self} Slower than real time: campaigns will take their time.",
            )
        return CheckVerdict.PASSED, str(self)


def measure_pace(connection: Connection, start: messages.SlotStart) -> BridgePace:
    """Measure the wall time of a step, after a first episode that makes the bridge load its parts.

    Raises:
        EpisodeError: the bridge fails.
        InvalidValue: the bridge cannot run an episode that it offers.
    """
    beside = min(connection.welcome.slots, MAX_BESIDE)
    dt_s = find_scenario(connection.welcome.offer, start.scenario).dt_s
    # Thrown away: a bridge may load maps and models in its first episode.
    _measure_step_s(connection, start, 1)
    alone_s, together_s = (_measure_step_s(connection, start, many) for many in (1, beside))
    return BridgePace(dt_s, alone_s, together_s, beside)


def _measure_step_s(connection: Connection, start: messages.SlotStart, beside: int) -> float:
    began_s = perf_counter()
    courses = _run_side_by_side(connection, start, [SEED] * beside)
    return (perf_counter() - began_s) / max(1, *(len(course) - 1 for course in courses))


def check_bridge(address: str, campaign: CampaignSpec | None = None) -> list[CheckResult]:
    """Run all checks with the first scenario and planner that the bridge offers.

    Every other scenario and planner must run one episode to its end. If a campaign is given, one of
    its episodes is run in place of the checks.

    Raises:
        InvalidValue: the address is not valid, or nothing may connect to it; or the campaign cannot
            be sent to a bridge.
    """
    try:
        with closing(Connection(check_address(address))) as connection:
            welcome = connection.welcome
    except EpisodeError as error:
        rest = (
            CheckResult(address, _name(check), CheckVerdict.SKIPPED, SKIPPED) for check in CHECKS
        )
        return [CheckResult(address, HELLO, CheckVerdict.BROKEN, str(error)), *rest]
    if campaign is not None:
        return [*_describe(address, welcome), _check_campaign(address, campaign)]
    return [*_describe(address, welcome), *_run_checks(address, welcome)]


def _check_campaign(address: str, campaign: CampaignSpec) -> CheckResult:
    """Run the first episode of a campaign under ordinary noise."""
    task = EpisodeTask(0, episode_seed(campaign.seed, 0), PriorSource())
    with closing(SharedConnection(address)) as connection:
        result = next(BridgeEngine(campaign.setup(), connection).run([task]))
    what = f"{campaign.scenario}, {campaign.planner}"
    if result.fault is not None:
        return CheckResult(what, EPISODE, CheckVerdict.BROKEN, result.fault.message)
    said = f"It is {result.outcome.word} after {result.steps} steps."
    return CheckResult(what, EPISODE, CheckVerdict.PASSED, said)


def _describe(address: str, welcome: messages.BridgeWelcome) -> Iterator[CheckResult]:
    """Yield what a bridge offers, with the defaults of parameters and settings."""
    said = f"{welcome.name} {welcome.version}: up to {welcome.slots} episodes side by side."
    yield CheckResult(address, HELLO, CheckVerdict.PASSED, said)
    for each in welcome.scenarios:
        known = {"steps": each.steps, "dt_s": each.dt_s, **(each.parameters or {})}
        yield CheckResult(each.name, "scenario", CheckVerdict.PASSED, _format_defaults(known))
    for planner in welcome.planners:
        defaults = _format_defaults(planner.settings or {})
        yield CheckResult(planner.name, "planner", CheckVerdict.PASSED, defaults)
    for what, names in (("channels", welcome.offer.channels), ("signals", welcome.offer.signals)):
        yield CheckResult(address, what, CheckVerdict.PASSED, ", ".join(names) or "none")


def _format_defaults(defaults: Mapping[str, Plain]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in defaults.items())


def _run_checks(address: str, welcome: messages.BridgeWelcome) -> Iterator[CheckResult]:
    """Yield the pace and each check; once the bridge has stopped answering, skip the rest."""
    rest = iter(_plan_checks(welcome))
    # First, as the bridge loads its parts in it: the checks then wait for no start.
    pace = _check_pace(address, _make_start(welcome, welcome.scenarios[0], welcome.planners[0]))
    yield pace
    if pace.verdict is not CheckVerdict.BROKEN or _is_reachable(address):
        for start, check in rest:
            checked = _run_check(address, start, check)
            yield checked
            # One dead bridge is one finding: every further check would wait for its time-out.
            if checked.verdict is CheckVerdict.BROKEN and not _is_reachable(address):
                break
    yield from _skip(rest)


def _plan_checks(welcome: messages.BridgeWelcome) -> Iterator[tuple[messages.SlotStart, Check]]:
    scenario, *scenarios = welcome.scenarios
    planner, *planners = welcome.planners
    for check in CHECKS:
        yield _make_start(welcome, scenario, planner), check
    for each in scenarios:
        yield _make_start(welcome, each, planner), counts_each_step
    for other in planners:
        yield _make_start(welcome, scenario, other), counts_each_step


def _make_start(
    welcome: messages.BridgeWelcome,
    scenario: messages.BridgeScenario,
    planner: messages.BridgePlanner,
) -> messages.SlotStart:
    channels = episode.list_injected(list_position(welcome))
    return messages.SlotStart(
        0, SEED, scenario.name, {}, planner.name, {}, scenario.steps, channels
    )


def _check_pace(address: str, start: messages.SlotStart) -> CheckResult:
    try:
        with closing(Connection(address)) as connection:
            verdict, said = measure_pace(connection, start).judge(start.steps, connection.timeouts)
    except EigenfailError as error:
        verdict, said = CheckVerdict.BROKEN, str(error)
    return CheckResult(f"{start.scenario}, {start.planner}", PACE, verdict, said)


def _run_check(address: str, start: messages.SlotStart, check: Check) -> CheckResult:
    verdict, said = CheckVerdict.PASSED, (check.__doc__ or "").partition("\n")[0]
    try:
        with closing(Connection(address)) as connection:
            check(connection, start)
    except (AssertionError, EigenfailError) as error:
        verdict, said = CheckVerdict.BROKEN, str(error)
    return CheckResult(f"{start.scenario}, {start.planner}", _name(check), verdict, said)


def _is_reachable(address: str) -> bool:
    try:
        Connection(address).close()
    except EpisodeError:
        return False
    return True


def _skip(rest: Iterable[tuple[messages.SlotStart, Check]]) -> Iterator[CheckResult]:
    for start, check in rest:
        what = f"{start.scenario}, {start.planner}"
        yield CheckResult(what, _name(check), CheckVerdict.SKIPPED, SKIPPED)


def _name(check: Check) -> str:
    return check.__name__.replace("_", " ")
