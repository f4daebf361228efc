"""Import of the perception noise of TIER IV's scenario_simulator_v2 from a ROS 2 parameter file.

Its parameters are explained in docs/developer_guide/Parameters.md of
https://github.com/tier4/scenario_simulator_v2. Sigma and rates are step functions of the distance
in an ellipse around the ego, errors are autoregressive, and detection is a Markov chain.
"""

from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from math import exp
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy import optimize

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.files import read_whole
from eigenfail.settings import convert
from eigenfail.values.channels import EVERY, MISSED, Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import MOST_LIKELY, Autoregressive, Markov, White
from eigenfail_noise_fit.jackknife import Array

RADII_M = (10.0, 20.0, 40.0, 60.0, 80.0, 120.0, 150.0, 180.0, 1000.0)
"""Ends of the steps over the distance where a file gives none. [m]"""

MOST_CORRELATION = 0.999
LEAST_SIGMA = 1e-4
LEAST_RATE = 1e-6
LARGEST = 1e300

LIKE_PARAMETERS = (
    "Give the ROS 2 parameter file of scenario_simulator_v2 with "
    "/perception/object_recognition/detection/objects and its noise."
)

Table = Mapping[str, Any]

_CURVE = dict.fromkeys(("ellipse_normalized_x_radius", "values"))
_CORRELATION = {
    "autocorrelation_coefficient": dict.fromkeys(("amplitude", "decay", "offset")),
    "ellipse_y_radii": None,
}
_ERROR = {**_CORRELATION, "mean": _CURVE, "standard_deviation": _CURVE}
_OTHERS = {
    "ellipse_y_radii": None,
    "yaw": _ERROR,
    "yaw_flip": {**_CORRELATION, "rate": None, "speed_threshold": None},
    "true_positive": {**_CORRELATION, "rate": _CURVE},
}
_ELLIPTIC = {**_OTHERS, "distance": _ERROR}
_LOCAL = {
    **_OTHERS,
    "position": {"x": _ERROR, "y": _ERROR},
    "noise_application_entities": dict.fromkeys(("types", "subtypes", "names")),
}
KNOWN: Mapping[int, Table] = {
    1: {"position": {"standard_deviation": None}, "missing_probability": None},
    2: _ELLIPTIC,
    3: _ELLIPTIC,
    4: _LOCAL,
}
"""Keys of the noise of a version, or of a configuration of it, with those of inner tables."""

TOPIC = dict.fromkeys(
    ("noise", "override_legacy_configuration", "delay", "range", "occlusionless", "version", "seed")
)
NOISE = {"model": {"version": None}, **dict.fromkeys(f"v{version}" for version in KNOWN)}


class ImportedNoise(NamedTuple):
    """Channels from a parameter file.

    Attributes:
        channels: the channels, for every vehicle.
        mapped: what each parameter has become, in sentences.
        left_out: what the channels lack, in sentences.
    """

    channels: tuple[Channel, ...]
    mapped: tuple[str, ...]
    left_out: tuple[str, ...]


class _Import:
    """Collects channels and sentences.

    Args:
        step_s: time step of the scenarios. [s]
        farthest_m: distance up to which lines are fitted to steps. [m]
    """

    def __init__(self, step_s: float, farthest_m: float) -> None:
        self._step_s = step_s
        self._distance_m = np.arange(0.0, farthest_m + 1.0)
        self.channels: list[Channel] = []
        self.mapped: list[str] = []
        self.left_out: list[str] = []

    def add_error(self, quantity: str, noise: Table, where: str, *, by_distance: bool) -> None:
        """Add the channel of an error with mean, standard deviation and correlation."""
        if _read_steps(noise, "mean", where, 0.0, self._distance_m).any():
            self.left_out.append(f"{where}.mean: channels have no bias.")
        sigma = _read_steps(noise, "standard_deviation", where, 0.0, self._distance_m)
        if not sigma.any():
            return
        if by_distance:
            slope, base = _fit_line(self._distance_m, sigma, LEAST_SIGMA)
        else:
            slope, base = 0.0, float(np.sqrt(np.mean(np.square(sigma))))
            if np.ptp(sigma):
                self.left_out.append(
                    f"{where}.standard_deviation: changes with the distance along the road, on "
                    f"which sigma of '{quantity}' does not depend. It has the root mean square."
                )
        apart = float(np.abs(slope * self._distance_m + base - sigma).max())
        phi = self._read_correlation(noise, where)
        shape = Autoregressive(phi) if phi > 0.0 else White()
        self.channels.append(Channel(f"{EVERY}.{quantity}", base, slope, shape))
        self.mapped.append(
            f"{where}: '{quantity}'; the line of sigma differs from the steps by up to {apart:.3g}."
        )

    def add_misses(self, noise: Table, where: str) -> None:
        """Add the channel of misses, from the rate of true positives and their correlation."""
        seen = _read_steps(noise, "rate", where, 1.0, self._distance_m)
        if (seen > 1.0).any():
            raise InvalidValue(f"{where}.rate.values", "is above 1.", LIKE_PARAMETERS)
        if (seen == 1.0).all():
            return
        changes = 1.0 - self._read_correlation(noise, where)
        duration = 1.0 / max(changes * float(seen.mean()), 1e-3)
        with np.errstate(divide="ignore"):
            begins = np.minimum((1.0 - seen) / seen / duration, MOST_LIKELY)
        slope, base = _fit_line(self._distance_m, begins, LEAST_RATE)
        base, slope = min(base, MOST_LIKELY), min(slope, MOST_LIKELY)
        rates = np.minimum(base + slope * self._distance_m, MOST_LIKELY)
        apart = float(np.abs(rates / (rates + 1.0 / duration) - (1.0 - seen)).max())
        shape = Markov(base, duration, slope) if slope else Markov(base, duration)
        self.channels.append(Channel(f"{EVERY}.{MISSED}", shape=shape))
        self.mapped.append(
            f"{where}: '{MISSED}'; the share missed differs from 1 − rate by up to {apart:.3g}."
        )
        if np.ptp(seen):
            self.left_out.append(
                f"{where}: misses last longer where they are frequent; here they last "
                f"{duration:.3g} steps on average at all distances."
            )

    def add_flips(self, noise: Table, where: str) -> None:
        """Say that headings are not reversed."""
        if _read_number(noise, "rate", where, 0.0):
            self.left_out.append(f"{where}: no channel reverses a heading.")

    def _read_correlation(self, noise: Table, where: str) -> float:
        place = f"{where}.autocorrelation_coefficient"
        table = _read_table(noise, "autocorrelation_coefficient", where)
        amplitude, decay, offset = (
            _read_number(table, name, place, 0.0) for name in ("amplitude", "decay", "offset")
        )
        phi = amplitude * exp(-decay * self._step_s) + offset
        if not -1.0 < phi < 1.0:
            problem = f"gives a correlation of {phi:.3g} after {self._step_s:g} s."
            raise InvalidValue(place, problem, "It must lie between −1 and 1.")
        if phi < 0.0:
            self.left_out.append(f"{place}: a negative correlation, {phi:.3g}, is taken as 0.")
        return min(max(phi, 0.0), MOST_CORRELATION)


def import_noise(file: Path, step_s: float, farthest_m: float, config: str | None) -> ImportedNoise:
    """Return the channels that a parameter file describes.

    Args:
        file: ROS 2 parameter file.
        step_s: time step of the scenarios. [s]
        farthest_m: distance up to which lines are fitted to steps. [m]
        config: name of the noise configuration; files of versions 3 and 4 may have several.

    Raises:
        UnknownName: the configuration does not exist.
        InvalidValue: the file cannot be read, describes no noise, or holds a value outside its
            bounds.
    """
    topic = _find_topic(_read_yaml(file), file)
    noise = _read_table(topic, "noise", "")
    version = _read_table(noise, "model", "noise").get("version", 1)
    if type(version) is not int or version not in READERS:
        known = ", ".join(map(str, READERS))
        raise InvalidValue(
            "noise.model.version", f"'{version}' is not known.", f"Versions are {known}."
        )
    where = f"noise.v{version}"
    table = _read_table(noise, f"v{version}", "noise")
    unused = [
        f"noise.{name}: is not of version {version}." for name in noise if _is_other(name, version)
    ]
    if version in NAMED:
        name = _choose_config(table, where, config)
        unused += [f"{where}.{each}: is another configuration." for each in table if each != name]
        table, where = _read_table(table, name, where), f"{where}.{name}"
    unused += _list_unknown(topic, TOPIC, "")
    unused += _list_unknown(noise, NOISE, "noise")
    unused += _list_unknown(table, KNOWN[version], where)
    collected = _Import(step_s, farthest_m)
    READERS[version](collected, table, where)
    collected.left_out += [*_list_other(topic, version), *unused]
    if not collected.channels:
        raise InvalidValue(
            where,
            "all of its noise is 0, or nothing that a channel can be.",
            "; ".join(collected.left_out) or LIKE_PARAMETERS,
        )
    model = msgspec.to_builtins(DisturbanceModel(channels=tuple(collected.channels)))
    convert(model, DisturbanceModel, where)
    # Names and texts of the file may hold line breaks, which would end a comment of the model.
    mapped, left_out = (
        tuple(" ".join(sentence.split()) for sentence in sentences)
        for sentences in (collected.mapped, collected.left_out)
    )
    return ImportedNoise(tuple(collected.channels), mapped, left_out)


def _is_other(name: object, version: int) -> bool:
    return name in NOISE and name not in {"model", f"v{version}"}


def _list_unknown(table: Table, known: Table, where: str) -> Iterator[str]:
    """Yield the keys of a table and its inner tables that are not read.

    Raises:
        UnknownName: a key resembles a known parameter that the table lacks.
    """
    for name, inner in table.items():
        place = f"{where}.{name}".strip(".")
        if name not in known:
            absent = [each for each in known if each not in table]
            if get_close_matches(str(name), absent):
                raise UnknownName(place, str(name), absent)
            yield f"{place}: is not known, and not read."
        elif isinstance(known[name], dict) and isinstance(inner, dict):
            yield from _list_unknown(inner, known[name], place)


def _read_v1(collected: _Import, table: Table, where: str) -> None:
    place = f"{where}.position"
    sigma = _read_number(_read_table(table, "position", where), "standard_deviation", place, 0.0)
    if sigma:
        for quantity in ("longitudinal", "lateral"):
            collected.channels.append(Channel(f"{EVERY}.{quantity}", sigma, 0.0, White()))
        collected.mapped.append(f"{place}.standard_deviation: 'longitudinal' and 'lateral'.")
    missing = _read_number(table, "missing_probability", where, 0.0)
    if missing >= 1.0:
        raise InvalidValue(f"{where}.missing_probability", "is 1 or more.", LIKE_PARAMETERS)
    if missing:
        shape = Markov(min(missing, MOST_LIKELY), min(1.0 / (1.0 - missing), 1000.0))
        collected.channels.append(Channel(f"{EVERY}.{MISSED}", shape=shape))
        collected.mapped.append(
            f"{where}.missing_probability: '{MISSED}', independent from step to step."
        )
        if missing > MOST_LIKELY:
            collected.left_out.append(
                f"{where}.missing_probability: a miss begins with a probability of "
                f"{MOST_LIKELY:g} at most."
            )


def _read_v2(collected: _Import, table: Table, where: str) -> None:
    radial = _with_radii(table, _read_table(table, "distance", where))
    collected.add_error("longitudinal", radial, f"{where}.distance", by_distance=True)
    if any(channel.name.endswith("longitudinal") for channel in collected.channels):
        collected.left_out.append(
            f"{where}.distance: is along the line of sight, here along the road; the same for "
            "vehicles straight ahead."
        )
    _read_others(collected, table, where)


def _read_v4(collected: _Import, table: Table, where: str) -> None:
    position, place = _read_table(table, "position", where), f"{where}.position"
    axes = {"y": ("longitudinal", True), "x": ("lateral", False)}
    for axis, (quantity, by_distance) in axes.items():
        noise = _with_radii(table, _read_table(position, axis, place))
        collected.add_error(quantity, noise, f"{place}.{axis}", by_distance=by_distance)
    if collected.channels:
        collected.left_out.append(
            f"{place}: is that of the point of the vehicle nearest to the ego, along the line of "
            "sight and across it; here that of the centre, along the road and across it."
        )
    _read_others(collected, table, where)


def _read_others(collected: _Import, table: Table, where: str) -> None:
    yaw = _with_radii(table, _read_table(table, "yaw", where))
    collected.add_error("heading", yaw, f"{where}.yaw", by_distance=True)
    collected.add_flips(_read_table(table, "yaw_flip", where), f"{where}.yaw_flip")
    seen = _with_radii(table, _read_table(table, "true_positive", where))
    collected.add_misses(seen, f"{where}.true_positive")
    if entities := table.get("noise_application_entities"):
        collected.left_out.append(
            f"{where}.noise_application_entities: {entities}; the channels are of every vehicle."
        )


READERS: dict[int, Callable[[_Import, Table, str], None]] = {
    1: _read_v1,
    2: _read_v2,
    3: _read_v2,
    4: _read_v4,
}
"""What reads the parameters of a version."""

NAMED = (3, 4)
"""Versions with named configurations."""


def _choose_config(table: Table, where: str, config: str | None) -> str:
    if config is not None:
        if config not in table:
            raise UnknownName("--config", config, tuple(table))
        return config
    if len(table) != 1:
        raise InvalidValue(
            where,
            f"has {len(table)} configurations: {', '.join(map(str, table))}.",
            "Choose with --config.",
        )
    return next(iter(table))


def _list_other(topic: Table, version: int) -> Iterator[str]:
    """Yield the parameters outside the noise that channels cannot express."""
    if not topic.get("override_legacy_configuration", False):
        values = "delay, range and occlusionless"
        yield (
            "override_legacy_configuration: is false, so that the simulator takes "
            f"{f'noise.v1, {values}' if version == 1 else values} from the scenario instead."
        )
    if delay := _read_number(topic, "delay", "", 0.0):
        yield f"delay: {delay:g} s, always the same; the channel 'delay' is drawn."
    if "range" in topic:
        yield f"range: beyond {topic['range']} m vehicles are not detected; here they are."
    if "seed" in topic:
        yield "seed: draws follow from the campaign's seed."
    if "version" in topic:
        yield f"version: {topic['version']}, of the file, is not read."
    if topic.get("occlusionless") is False:
        yield "occlusionless: is false; set `occlusion = true`, whose sensor is the ego's front."


def _read_yaml(file: Path) -> Any:
    # Other commands do without it.
    import yaml

    try:
        return yaml.safe_load(read_whole(file).decode())
    except OSError as error:
        problem = f"cannot be read: {error.strerror}."
        raise InvalidValue(str(file), problem, LIKE_PARAMETERS) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        problem = f"is not YAML: {' '.join(str(error).split())}."
        raise InvalidValue(str(file), problem, LIKE_PARAMETERS) from error


def _find_topic(content: Any, file: Path) -> Table:
    """Return the innermost table that has the noise of detected objects."""
    # Aliases may make a table part of itself.
    waiting, seen = [content], set[int]()
    while waiting:
        table = waiting.pop(0)
        if not isinstance(table, dict) or id(table) in seen:
            continue
        seen.add(id(table))
        if isinstance(table.get("noise"), dict) and "model" in table["noise"]:
            return table
        waiting += table.values()
    raise InvalidValue(str(file), "has no noise.model.", LIKE_PARAMETERS)


def _with_radii(table: Table, noise: Table) -> Table:
    return {"ellipse_y_radii": table.get("ellipse_y_radii", list(RADII_M)), **noise}


def _read_table(table: Table, name: str, where: str) -> Table:
    inner = table.get(name, {})
    if not isinstance(inner, dict):
        raise InvalidValue(f"{where}.{name}".strip("."), "is not a table.", LIKE_PARAMETERS)
    return inner


def _read_number(table: Table, name: str, where: str, default: float) -> float:
    """Return a number of 0 or more, but for offsets and means, which may be negative."""
    value = table.get(name, default)
    signed = name in {"offset", "amplitude"}
    if not _is_number(value) or (value < 0.0 and not signed):
        problem = f"'{value}' is not a {'number' if signed else 'number of 0 or more'}."
        raise InvalidValue(f"{where}.{name}".strip("."), problem, LIKE_PARAMETERS)
    return float(value)


def _is_number(value: Any) -> bool:
    # A comparison, as no whole number is too large for it.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and -LARGEST < value < LARGEST


def _read_steps(noise: Table, name: str, where: str, default: float, distance_m: Array) -> Array:
    """Return a value at each distance straight ahead, from steps over an ellipse.

    Raises:
        InvalidValue: there are not as many values as radii, or one is not a number or negative.
    """
    radii, place = noise["ellipse_y_radii"], f"{where}.{name}"
    table = _read_table(noise, name, where)
    values = table.get("values", [default] * len(radii))
    for field, given in ((f"{where}: ellipse_y_radii", radii), (f"{place}.values", values)):
        if not isinstance(given, list) or not given or not all(map(_is_number, given)):
            raise InvalidValue(field, "is not a list of numbers.", LIKE_PARAMETERS)
    if len(values) != len(radii):
        problem = f"has {len(values)} values, and ellipse_y_radii {len(radii)}."
        raise InvalidValue(f"{place}.values", problem, "Give one for each radius.")
    if name != "mean" and min(values) < 0.0:
        raise InvalidValue(f"{place}.values", "has a negative value.", LIKE_PARAMETERS)
    if sorted(radii) != radii:
        raise InvalidValue(f"{where}: ellipse_y_radii", "do not grow.", "Sort the radii.")
    ratio = _read_number(table, "ellipse_normalized_x_radius", place, 1.0)
    if not ratio:
        field = f"{place}.ellipse_normalized_x_radius"
        raise InvalidValue(field, "is 0, so that every distance is infinite.", "Give 1.0.")
    number = np.searchsorted(np.array(radii, float), distance_m / ratio, "right")
    steps: Array = np.array(values, float)[np.minimum(number, len(values) - 1)]
    return steps


def _fit_line(distance_m: Array, values: Array, least: float) -> tuple[float, float]:
    """Return slope and base of the line nearest to values, the base not below `least`."""
    columns = np.column_stack([distance_m, np.ones_like(distance_m)])
    (slope, base), _ = optimize.nnls(columns, values)
    return float(slope), max(float(base), least)
