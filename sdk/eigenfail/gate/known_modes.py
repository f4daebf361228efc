"""The failure modes of a baseline, as campaigns that inject them into another planner."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from eigenfail.gate.known import Drawn, KnownFailure, KnownReplay, Under, in_scenario
from eigenfail.values import Analysis, Campaign, FailureMode, Outcome


def replays_of_modes(
    under: Under, before: Campaign, analysis: Analysis, drawn: Drawn
) -> Iterator[KnownReplay]:
    """The eigenfailures and medoids of an analysis, each in its own scenario.

    Where the scenario's parameters vary, an eigenfailure's own scenario is that of its medoid:
    modes whose medoids drew the same share a campaign.

    Args:
        under: the planner.
        before: the campaign that was analysed.
        analysis: done, with at least one mode.
        drawn: see `Drawn`.
    """
    modes = analysis.result.modes if analysis.result else ()
    for parameters, places in by_scenario(modes, drawn):
        world = in_scenario(before.spec, parameters)
        where = f" as in {before.id}/{modes[places[0]].medoid}" if parameters else ""
        eigenfailures = under.replay(
            f"eigenfailures of analysis {analysis.id}{where}",
            world,
            settings={"analysis": analysis.id},
            episodes=len(modes),
        )
        yield KnownReplay(eigenfailures, {n: eigenfailure(analysis.id, n) for n in places})
        medoids = [modes[place].medoid for place in places]
        again = under.replay(
            f"medoids of analysis {analysis.id}{where}",
            world,
            settings={"campaign": before.id, "episodes": medoids},
            episodes=len(medoids),
        )
        known = {n: medoid(place, before.id, modes[place]) for n, place in enumerate(places)}
        yield KnownReplay(again, known)


def by_scenario(
    modes: Sequence[FailureMode], drawn: Drawn
) -> Iterator[tuple[Mapping[str, Any], list[int]]]:
    """The modes by what their medoids drew, in order."""
    groups: dict[bytes, tuple[Mapping[str, Any], list[int]]] = {}
    for place, mode in enumerate(modes):
        parameters = drawn(mode.medoid)
        key = msgspec.json.encode(dict(parameters), order="sorted")
        groups.setdefault(key, (parameters, []))[1].append(place)
    yield from groups.values()


def eigenfailure(analysis: int, place: int) -> KnownFailure:
    """The eigenfailure of a mode: nobody knows yet whether it fails."""
    return KnownFailure(f"eigenfailure {place + 1} of analysis {analysis}")


def medoid(place: int, campaign: int, mode: FailureMode) -> KnownFailure:
    """The medoid of a mode: an episode that did fail."""
    was = f"{campaign}/{mode.medoid}"
    return KnownFailure(f"medoid {place + 1}, {was}", was, Outcome.COLLISION)
