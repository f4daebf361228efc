"""One episode of a campaign in a slot of a bridge: its requests, observations and result."""

from collections.abc import Sequence
from time import perf_counter
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from eigenfail import bridges
from eigenfail.errors import EpisodeError, InputError, InvalidValue, SimulatorError
from eigenfail.values.arrays import LARGEST_FLOAT32, Floats, find_lost
from eigenfail.values.channels import CHANNELS_FIELD, Channel, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.proof import Account
from eigenfail.values.requirements import EpisodeJudge
from eigenfail.values.scene import (
    UNKNOWN_KIND,
    VEHICLE_KINDS,
    Control,
    Observation,
    Scene,
    VehicleState,
)
from eigenfail.values.shapes import Row
from eigenfail_workers.accounts import RecordedStep, read_account, thin_path
from eigenfail_workers.bridge import messages
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.episode import EpisodeDriver, make_errored_result, make_result
from eigenfail_workers.faults import make_fault, wrap_errors
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.campaign_noise import CampaignNoise
from eigenfail_workers.perception import NOWHERE, SensorErrors
from eigenfail_workers.values import Point


class BridgeCampaign(NamedTuple):
    """The setup that the episodes of a campaign on a bridge share.

    Attributes:
        setup: setup of the campaign.
        settings: settings of the planner.
        model: model of the disturbances, with its channels written out.
        noise: begins the noise of each episode.
        judge: what judges the episodes; None if only no collision is required.
        recorded: list that is filled with the steps of the last episode, as the bridge explains
            them; None if it is not asked to.
    """

    setup: EpisodeSetup
    settings: dict[str, bridges.Plain]
    model: DisturbanceModel
    noise: CampaignNoise
    judge: EpisodeJudge | None
    recorded: list[RecordedStep] | None


class BridgeEpisode:
    """An episode from its request to its result.

    Args:
        campaign: campaign of the episode.
        task: task of the episode.
        parameters: parameters of its scenario, with `steps` and `dt_s`.
        welcome: what the bridge offers.

    Attributes:
        task: task of the episode.

    Raises:
        UnknownName: the bridge does not know the scenario, the planner, a parameter, a setting, a
            channel or a signal.
        InvalidValue: the scenario has fewer steps, or steps of another duration; or the noise of
            the episode cannot be provided.
    """

    def __init__(
        self,
        campaign: BridgeCampaign,
        task: EpisodeTask,
        parameters: msgspec.Struct,
        welcome: messages.BridgeWelcome,
    ) -> None:
        self.task = task
        self._campaign = campaign
        self._welcome = welcome
        self._parameters = bridges.select_bridge_parameters(parameters)
        named = msgspec.structs.asdict(parameters)
        self._steps, self._dt_s = int(named["steps"]), float(named["dt_s"])
        offer = welcome.offer
        bridges.check_demand(
            offer,
            bridges.EpisodeDemand(
                campaign.setup.scenario,
                campaign.setup.planner,
                self._parameters,
                campaign.settings,
                self._steps,
                self._dt_s,
            ),
        )
        bridges.check_channels(offer, [channel.name for channel in campaign.noise.perceived])
        if campaign.judge is not None:
            bridges.check_signals(offer, campaign.judge.signals)
        # After the checks: only time that the bridge can be blamed for counts.
        self._wall_s, self._measured_s = 0.0, perf_counter()
        model = campaign.model
        self._recorder = Recorder(model, task.importance, campaign.judge)
        self._noise = campaign.noise.begin(task, self._steps)
        self._driver = EpisodeDriver(model, self._noise, self._recorder, self._steps, self._dt_s)
        self._reader = ObservationReader(campaign.noise.perceived, self._dt_s)
        self._disturbance: Row = ()
        # A repeated episode, after a lost bridge, must not append to the steps of the first try.
        if campaign.recorded is not None:
            campaign.recorded.clear()

    @property
    def has_begun(self) -> bool:
        """True if the bridge has reported the start of the episode."""
        return self._reader.has_begun

    def make_start(self, slot: int) -> messages.SlotStart:
        """Return the part of a reset request for a slot."""
        setup, seed = self._campaign.setup, self.task.seed
        return messages.SlotStart(
            slot,
            str(seed) if self._welcome.seed_text else seed,
            setup.scenario,
            self._parameters,
            setup.planner,
            self._campaign.settings,
            self._steps,
            list_injected(self._campaign.noise.perceived),
            self._campaign.recorded is not None,
        )

    def make_step(self, slot: int) -> messages.SlotStep:
        """Return the part of the next step request for a slot."""
        return make_step(slot, self._campaign.noise.perceived, self._disturbance)

    def advance(
        self, seen: messages.SlotObservation, beside: int, connection: Connection
    ) -> EpisodeResult | None:
        """Take in an observation, and return the result if the episode is over.

        Args:
            seen: answer to the last request.
            beside: number of episodes that share the bridge's time, including this one.
            connection: connection to the bridge.
        """
        try:
            with wrap_errors(SimulatorError, "The episode", "Look into the bridge."):
                return self._advance(seen, beside, connection)
        except (EpisodeError, InputError) as error:
            return self.fail(error, beside)

    def _advance(
        self, seen: messages.SlotObservation, beside: int, connection: Connection
    ) -> EpisodeResult | None:
        wall_s = self._measure_wall_s(beside)
        now = self._reader.read(seen, self._disturbance)
        if self._campaign.recorded is not None and now.step:
            step = record_step(seen, now, self._dt_s)
            account = self._reader.number_vehicles(step.account)
            self._campaign.recorded.append(step._replace(account=account))
        disturbance = self._driver.disturb(now)
        if disturbance is None:
            done = make_result(
                self._campaign.setup, self.task, self._noise, self._recorder, self._dt_s
            )
            scene = done.scene and self._reader.complete_scene(done.scene)
            return replace(done, wall_s=wall_s, scene=scene)
        self._disturbance = disturbance
        # After the observation was taken in: an episode that has just ended is not late.
        if wall_s > connection.timeouts.episode_s:
            raise connection.make_timeout()
        return None

    def fail(self, error: EpisodeError | InputError, beside: int) -> EpisodeResult:
        """Return the result of an episode that an error has ended."""
        failed = make_errored_result(self.task, self._recorder, make_fault(error))
        return replace(failed, wall_s=self._measure_wall_s(beside))

    def _measure_wall_s(self, beside: int) -> float:
        """Share of this episode in the wall time, divided among open episodes. [s]"""
        now_s = perf_counter()
        # A step serves all episodes that run, and nobody can say how much of it was whose.
        self._wall_s += (now_s - self._measured_s) / beside
        self._measured_s = now_s
        return self._wall_s


def list_injected(channels: tuple[Channel, ...]) -> tuple[messages.InjectedChannel, ...]:
    """Return the channels of an episode in the form that a reset sends."""
    return tuple(messages.InjectedChannel(channel.name, channel.ahead_m) for channel in channels)


def make_step(slot: int, channels: tuple[Channel, ...], disturbance: Row) -> messages.SlotStep:
    """Return the part of a step request for a slot."""
    names = [channel.name for channel in channels]
    return messages.SlotStep(slot, dict(zip(names, disturbance, strict=True)))


class ObservationReader:
    """Reads the observations of one episode, in their order.

    Args:
        channels: the channels, in the order of the disturbances.
        dt_s: duration of a step.
    """

    def __init__(self, channels: tuple[Channel, ...], dt_s: float) -> None:
        self._channels = channels
        self._errors = SensorErrors(channels)
        self._dt_s = dt_s
        self._last: Observation | None = None
        self._vehicles: dict[int | str, tuple[int, Point]] = {}
        self._kinds: dict[int, str] = {}
        self._road: tuple[Floats, ...] | UnsetType = UNSET

    @property
    def has_begun(self) -> bool:
        """True if the start has been read."""
        return self._last is not None

    def read(self, seen: messages.SlotObservation, disturbance: Row) -> Observation:
        """Return the true state at the start, or after a step with the planner's control.

        If the bridge does not report the perceived position, the position follows from the
        disturbance; it is NaN if vehicles come and go. If the bridge does not report the control,
        the control follows from the change of speed, without steering.

        Args:
            seen: observation of the bridge.
            disturbance: a_t of each channel in the step just taken; without effect at the start.

        Raises:
            EpisodeError: the episode did not begin, or cannot go on.
            InvalidValue: the bridge cannot do what the campaign requires.
        """
        before = self._last
        now = self._read_start(seen) if before is None else self._go_on(seen, before, disturbance)
        self._note_kinds(seen, now)
        self._last = now
        return now

    def number_vehicles(self, account: Account) -> Account:
        """Return an account that names vehicles by their numbers in the scene, not by their ids.

        Without `ids`, the account is unchanged. If an id was never shown, it remains in `vehicle`
        and is left out of `lost_vehicles`.
        """
        if not self._vehicles:
            return account
        numbers = {str(name): number for name, (number, _) in self._vehicles.items()}
        numbered = dict(account)
        named = account.get("vehicle")
        if named is not None:
            number = numbers.get(_write_id(named))
            numbered["vehicle"] = _write_id(named) if number is None else float(number)
        lost = account.get("lost_vehicles")
        if isinstance(lost, str | float):
            each = [str(numbers[one]) for one in _write_id(lost).split() if one in numbers]
            numbered["lost_vehicles"] = " ".join(each)
        return numbered

    def complete_scene(self, scene: Scene) -> Scene:
        """Return the scene of the episode with the road and the kinds that the bridge reported."""
        kinds: tuple[str, ...] | UnsetType = UNSET
        if self._kinds:
            numbers = range(len(scene.sizes))
            kinds = tuple([self._kinds.get(number, UNKNOWN_KIND) for number in numbers])
        return replace(scene, road=self._road, kinds=kinds)

    def _note_kinds(self, seen: messages.SlotObservation, now: Observation) -> None:
        """Keep the first kind that the bridge reports of each vehicle."""
        if seen.kinds is None:
            return
        if len(seen.kinds) != len(now.others):
            problem = f"The {len(now.others)} other vehicles have {len(seen.kinds)} kinds."
            raise SimulatorError(problem, "Give one for each, in their order, or leave them out.")
        for number, kind in zip(now.numbers, seen.kinds, strict=True):
            self._kinds.setdefault(number, kind if kind in VEHICLE_KINDS else UNKNOWN_KIND)

    def _read_start(self, seen: messages.SlotObservation) -> Observation:
        ego, others = _read_ego(seen, 0), _read_others(seen)
        ids = self._register(seen, others)
        for channel in self._channels:
            vehicle = split_name(channel.name).vehicle
            # With `ids` a vehicle may come later: its channel waits for it.
            if ids is None and vehicle is not None and vehicle > len(others):
                problem = f"'{channel.name}' is of vehicle {vehicle}, and there are {len(others)}."
                raise InvalidValue(CHANNELS_FIELD, problem, "Vehicles are numbered from 1.")
        if seen.road:
            self._road = tuple([_read_border(border) for border in seen.road])
        return Observation(
            0,
            ego,
            others,
            bool(seen.collided),
            bool(seen.ended),
            off_road=bool(seen.off_road),
            ids=ids,
            signals=seen.signals,
            peak_braking_mps2=seen.peak_braking_mps2,
        )

    def _go_on(
        self, seen: messages.SlotObservation, before: Observation, disturbance: Row
    ) -> Observation:
        ego, others = _read_ego(seen, before.step + 1), _read_others(seen)
        ids = self._register(seen, others)
        # Vehicles are told apart by place or by id; a mixture would mix up two vehicles in silence.
        if (ids is None) is not (before.ids is None):
            problem = "Some observations of the episode have `ids`, and some do not."
            raise SimulatorError(problem, "Give them in each, or in none.")
        if ids is None and len(others) != len(before.others):
            problem = f"There were {len(before.others)} other vehicles, and now {len(others)}."
            remedy = "Without `ids`, a bridge shows all of them in every observation."
            raise SimulatorError(problem, remedy)
        position = NOWHERE
        if ids is None:
            _, position = self._errors.perceive(before, self._dt_s, disturbance)
        faster_mps = ego.speed_mps - before.ego.speed_mps
        return Observation(
            before.step + 1,
            ego,
            others,
            bool(seen.collided),
            bool(seen.ended),
            seen.perceived or position,
            Control(*(seen.control or (faster_mps / self._dt_s, 0.0))),
            Control(*seen.applied) if seen.applied else None,
            bool(seen.off_road),
            ids=ids,
            signals=seen.signals,
        )

    def _register(
        self, seen: messages.SlotObservation, others: tuple[VehicleState, ...]
    ) -> tuple[int, ...] | None:
        """Return numbers for `others`, by order of first appearance; None without ids."""
        ids = seen.ids
        if ids is None:
            return None
        if len(ids) != len(others) or len(set(ids)) != len(ids):
            problem = f"The {len(others)} other vehicles have the ids {list(ids)}."
            raise SimulatorError(problem, "Each vehicle has an id of its own.")
        for name, other in zip(ids, others, strict=True):
            size = other.length_m, other.width_m
            # A footprint that changes is probably a new vehicle under an old id.
            known = self._vehicles.setdefault(name, (len(self._vehicles) + 1, size))
            if known[1] != size:
                problem = f"Vehicle {name!r} had another footprint before."
                raise SimulatorError(problem, "Give each new vehicle an id that was not used.")
        if len(self._vehicles) > messages.MAX_VEHICLES:
            problem = f"There were more than {messages.MAX_VEHICLES} other vehicles in one episode."
            raise SimulatorError(problem, "Shorten the episode, or show those near the ego alone.")
        return tuple([self._vehicles[name][0] for name in ids])


def _write_id(named: str | float) -> str:
    """Return the id of a vehicle in an account as text; accounts hold integers as floats."""
    return named if isinstance(named, str) else f"{named:.0f}"


def record_step(seen: messages.SlotObservation, now: Observation, dt_s: float) -> RecordedStep:
    """Return the bridge's explanation of the planner's decision in the step just taken."""
    # An account may be plain text: it is kept under one name.
    given = {"account": seen.account} if isinstance(seen.account, str) else seen.account
    account, path = read_account(given or {}), thin_path(seen.path or ())
    return RecordedStep((now.step - 1) * dt_s, now.control or Control(0.0, 0.0), account, path)


def _read_ego(seen: messages.SlotObservation, step: int) -> VehicleState:
    """Return the ego of an observation; the observation must show the given step."""
    if seen.fault is not None:
        raise messages.make_error(seen.fault, seen.message)
    if seen.ego is None or not seen.others:
        missing = "no ego" if seen.ego is None else "no other vehicles"
        problem = f"The bridge's observation has {missing}."
        raise SimulatorError(problem, "docs/bridge.md says what an observation holds.")
    if seen.step != step:
        problem = f"The bridge shows step {seen.step} where step {step} is due."
        raise SimulatorError(problem, "It counts the steps since the reset, from 0.")
    return VehicleState(*seen.ego)


def _read_others(seen: messages.SlotObservation) -> tuple[VehicleState, ...]:
    return tuple([VehicleState(*vehicle) for vehicle in seen.others])


def _read_border(border: Sequence[Sequence[float]]) -> Floats:
    """Return the points of a border of the road, shape (points, 2).

    Raises:
        SimulatorError: a number is outside the range that is kept.
    """
    points = np.array(border, np.float64)
    if (lost := find_lost(points)) is not None:
        problem = f"A border of the road holds {lost:g}."
        raise SimulatorError(problem, f"Numbers of a scene are kept up to ±{LARGEST_FLOAT32:g}.")
    return points.astype(np.float32)
