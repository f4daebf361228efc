"""Sensors that are worse or better than a campaign's: multiples of the errors of its channels.

The size of a channel's error is its sigma, at no distance and by distance alike, or the rate of an
event. The name `scale` means the scale of the disturbance model, which multiplies every sigma.
"""

from collections.abc import Iterable, Mapping
from functools import reduce
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.presentation.figures import put_unit
from eigenfail.settings import convert
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import PARAMETER, Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import Markov
from eigenfail.worlds import world_of

SCALE = "scale"

FIELD = "channels"

Multiples = Mapping[str, float]
"""By what the error of each channel is multiplied; 1 for channels that are not there."""


def check_channels(spec: CampaignSpec, names: Iterable[str]) -> None:
    """Refuse channels whose error cannot be scaled.

    Raises:
        UnknownName: the campaign lacks a channel; the names that it has are listed.
        InvalidValue: no channel, one that is named twice, or one without a sigma or rate.
    """
    named = tuple(names)
    known = {channel.name: channel for channel in _list_own_channels(spec)}
    if not named:
        raise InvalidValue(FIELD, "names no channel.", f"Known: {', '.join((*known, SCALE))}.")
    for place, name in enumerate(named):
        if name != SCALE and name not in known:
            raise UnknownName(FIELD, name, (*known, SCALE))
        if name in named[:place]:
            raise InvalidValue(FIELD, f"'{name}' is there twice.", "Name each channel once.")
        if name in known and known[name].kind is PARAMETER:
            problem = f"'{name}' has neither a sigma nor a rate: it is a draw of the scenario."
            raise InvalidValue(FIELD, problem, "Name a channel of the sensor.")


def _list_own_channels(spec: CampaignSpec) -> tuple[Channel, ...]:
    # Of functions only the scale can be set: there is no distance that a sigma could grow with.
    return spec.disturbance.list_channels() if world_of(spec.simulator).has_road else ()


def scale_model(model: DisturbanceModel, multiples: Multiples) -> DisturbanceModel:
    """Return the disturbance model with the errors of some channels multiplied.

    Raises:
        InvalidValue: an error would lie outside its bounds.
    """
    scaled = reduce(lambda last, item: _scale_one(last, *item), multiples.items(), model)
    try:
        return convert(msgspec.to_builtins(scaled), DisturbanceModel, "disturbance")
    except InvalidValue as error:
        times = ", ".join(f"{multiple:g} × {name}" for name, multiple in multiples.items())
        raise InvalidValue("high", f"{times}: {error.problem}", "Search lower.") from None


def _scale_one(model: DisturbanceModel, name: str, multiple: float) -> DisturbanceModel:
    if name == SCALE:
        return replace(model, scale=model.scale * multiple)
    if isinstance(model.channels, msgspec.UnsetType):
        sizes = (f"{name}_base_m", f"{name}_slope")
        changed: dict[str, Any] = {size: getattr(model, size) * multiple for size in sizes}
        return replace(model, **changed)
    channels = [
        _scale_channel(channel.filled(), multiple) if channel.name == name else channel
        for channel in model.channels
    ]
    return replace(model, channels=tuple(channels))


def _scale_channel(channel: Channel, multiple: float) -> Channel:
    if isinstance(channel.shape, Markov):
        rate, growth_per_m = channel.shape.rate * multiple, channel.shape.growth_per_m * multiple
        return replace(channel, shape=replace(channel.shape, rate=rate, rate_per_m=growth_per_m))
    sigma, growth = channel.sigma or 0.0, channel.sigma_per_m or 0.0
    return replace(channel, sigma=sigma * multiple, sigma_per_m=growth * multiple)


def describe_size(model: DisturbanceModel, name: str) -> str:
    """Return a phrase with a gap for a multiple: "longitudinal sigma up to {} × (1 m + 0.02·d)"."""
    if name == SCALE:
        return "every sigma up to {} × its own"
    channel = next(one for one in model.list_channels() if one.name == name)
    if isinstance(channel.shape, Markov):
        rate = _describe_growth(f"{channel.shape.rate:g}", channel.shape.growth_per_m)
        return f"{name} rate up to {{}} × {rate} a step"
    sigma, growth = (model.scale * (each or 0.0) for each in (channel.sigma, channel.sigma_per_m))
    size = _describe_growth(put_unit(f"{sigma:g}", channel.unit), growth)
    return f"{name} sigma up to {{}} × {size}"


def _describe_growth(size: str, per_m: float) -> str:
    return f"({size} + {per_m:g}·d)" if per_m else size
