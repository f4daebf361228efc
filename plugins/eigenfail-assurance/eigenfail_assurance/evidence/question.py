"""Claims and the outputs that are to support them: the file of `eigenfail evidence`."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.files import read_toml, read_whole
from eigenfail.gate.report import GateReport
from eigenfail.settings import convert
from eigenfail_assurance.risk.question import CampaignReference, RiskQuestion, read_risk_file
from eigenfail_assurance.sensor.search import RequirementAnswer

MOST_CLAIMS = 500
DEEPEST_CLAIM = 20
LONGEST_TEXT = 1_000
LARGEST_OUTPUT = 2**26
"""Size of a file of another command that is read at most. [bytes]"""

LIKE_EVIDENCE = (
    "Name a TOML file with a [claim] and its solutions, as "
    "plugins/eigenfail-assurance/examples/evidence.toml."
)

Text = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_TEXT)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Chance = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]
Assurance = Annotated[float, msgspec.Meta(ge=0.5, le=0.999999)]
References = Annotated[tuple[CampaignReference, ...], msgspec.Meta(min_length=1, max_length=100)]


class _Solution(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"
):
    """An output with its criterion."""


class ProbabilitySolution(_Solution, frozen=True, kw_only=True, tag="p_failure"):
    """A campaign's estimate of P(failure), with a bound.

    Attributes:
        campaigns: ids or names. Several are counted together; this requires Monte Carlo campaigns
            with different seeds.
        at_most: largest probability that is accepted.
        confidence: confidence of the one-sided bound that is compared with `at_most`.
    """

    campaigns: References
    at_most: Chance
    confidence: Assurance = 0.95


class RiskSolution(_Solution, frozen=True, kw_only=True, tag="risk"):
    """Failures per hour or per 10^6 km against a target; in a file, `file` names the question."""

    question: RiskQuestion


class SearchSolution(_Solution, frozen=True, kw_only=True, tag="search"):
    """Failures found by campaigns of any method: a count, not a probability.

    Attributes:
        campaigns: ids or names.
        failures_at_most: largest number of failures that is accepted.
        episodes_at_least: smallest number of completed episodes.
    """

    campaigns: References
    failures_at_most: Annotated[int, msgspec.Meta(ge=0)] = 0
    episodes_at_least: Annotated[int, msgspec.Meta(ge=1)] = 1


class ReplaySolution(_Solution, frozen=True, kw_only=True, tag="replay"):
    """The proof by replay of the newest analysis of a campaign.

    Attributes:
        campaign: id or name.
        reproduced_at_least: smallest share of the eigenfailures that fail again in the scenario of
            their failures.
    """

    campaign: CampaignReference
    reproduced_at_least: Share = 1.0


class GateSolution(_Solution, frozen=True, kw_only=True, tag="gate"):
    """A gate that must be open; in a file, `file` names the output of `eigenfail gate --json`."""

    report: GateReport


class SensorSolution(_Solution, frozen=True, kw_only=True, tag="requirement"):
    """A sensor's largest error.

    In a file, `file` names the output of `eigenfail requirement --json`.

    Attributes:
        answer: requirement on the sensor, as found by the search.
        channel: name of the channel.
        multiple: multiple of its error at which the target of the answer must be met.
    """

    answer: RequirementAnswer
    channel: str
    multiple: Annotated[float, msgspec.Meta(gt=0.0)] = 1.0


AnySolution = (
    ProbabilitySolution
    | RiskSolution
    | SearchSolution
    | ReplaySolution
    | GateSolution
    | SensorSolution
)


class Claim(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A claim, and how it is argued.

    Attributes:
        text: the claim, as a sentence.
        argument: strategy that joins its sub-claims or solutions; empty for none.
        context: what the words of the claim refer to, in sentences.
        assumptions: statements taken to be true without evidence, besides the assumptions of
            solutions.
        claims: sub-claims; all of them are needed.
        solutions: outputs; all of them are needed.
    """

    text: Text
    argument: Annotated[str, msgspec.Meta(max_length=LONGEST_TEXT)] = ""
    context: tuple[Text, ...] = ()
    assumptions: tuple[Text, ...] = ()
    claims: "tuple[Claim, ...]" = ()
    solutions: tuple[AnySolution, ...] = ()

    def list_solutions(self) -> Iterator[AnySolution]:
        """Yield the claim's own solutions, then its sub-claims' solutions, in order."""
        yield from self.solutions
        for each in self.claims:
            yield from each.list_solutions()


class EvidenceQuestion(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Claims on a planner, with the solutions that are to support them.

    Attributes:
        name: name of the argument.
        claim: the top claim.
    """

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    claim: Claim

    def __post_init__(self) -> None:
        """Raise InvalidValue for more claims than a graph can show."""
        count, depth = _measure_claim(self.claim)
        if count > MOST_CLAIMS or depth > DEEPEST_CLAIM:
            problem = f"{count} claims, {depth} deep, are too many."
            remedy = f"Give up to {MOST_CLAIMS}, {DEEPEST_CLAIM} deep."
            raise InvalidValue("claim", problem, remedy)


def _measure_claim(claim: Claim) -> tuple[int, int]:
    """Return the number of claims from a claim down, and of their levels."""
    below = [_measure_claim(each) for each in claim.claims]
    return 1 + sum(count for count, _ in below), 1 + max((deep for _, deep in below), default=0)


def read_evidence_file(file: Path | str) -> EvidenceQuestion:
    """Return the question in a TOML file, with the files that it names read in.

    Without a name it is named after the file.

    Raises:
        InvalidValue: a file cannot be read, a field is unknown, or a value is of the wrong type or
            outside its bounds; the error names the field.
    """
    path = Path(file)
    given = {"name": path.stem, **read_toml(path, LIKE_EVIDENCE)}
    if isinstance(claim := given.get("claim"), dict):
        given["claim"] = _read_outputs(claim, path.parent, "claim")
    return convert(given, EvidenceQuestion, path.name)


def _read_outputs(claim: Mapping[str, Any], folder: Path, field: str) -> dict[str, Any]:
    """Return a claim with the content of the files that its solutions name."""
    if field.count(".") >= DEEPEST_CLAIM:
        # Deeper ones would end the reader, which calls itself for each level.
        remedy = f"Give claims up to {DEEPEST_CLAIM} deep."
        raise InvalidValue("claim", "claims are nested too deeply.", remedy)
    read = dict(claim)
    if isinstance(solutions := claim.get("solutions"), list):
        read["solutions"] = [
            _read_output(each, folder, f"{field}.solutions[{place}].file")
            for place, each in enumerate(solutions)
        ]
    if isinstance(claims := claim.get("claims"), list):
        read["claims"] = [
            _read_outputs(each, folder, f"{field}.claims[{place}]")
            if isinstance(each, dict)
            else each
            for place, each in enumerate(claims)
        ]
    return read


def _read_output(solution: Any, folder: Path, field: str) -> Any:
    if not isinstance(solution, dict) or "file" not in solution:
        return solution
    others = {name: value for name, value in solution.items() if name != "file"}
    name, kind = solution["file"], str(solution.get("kind"))
    if not isinstance(name, str) or kind not in _FILE_FIELDS:
        kinds = ", ".join(_FILE_FIELDS)
        raise InvalidValue(field, f"only solutions of the kinds {kinds} name a file.")
    return others | {_FILE_FIELDS[kind]: _FILE_READERS[kind](folder / name, field)}


def _read_risk(path: Path, _field: str) -> Any:
    return msgspec.to_builtins(read_risk_file(path))


def _read_gate(path: Path, field: str) -> Any:
    return msgspec.to_builtins(convert(_read_json(path, field), GateReport, field))


def _read_requirement(path: Path, field: str) -> Any:
    found = _read_json(path, field)
    answer = found.get("answer") if isinstance(found, dict) else None
    return msgspec.to_builtins(convert(answer, RequirementAnswer, f"{field}: answer"))


_FILE_READERS = {"risk": _read_risk, "gate": _read_gate, "requirement": _read_requirement}
_FILE_FIELDS = {"risk": "question", "gate": "report", "requirement": "answer"}


def _read_json(path: Path, field: str) -> Any:
    try:
        content = read_whole(path, LARGEST_OUTPUT)
    except OSError as error:
        raise InvalidValue(field, f"'{path}' cannot be read: {error.strerror}.") from error
    try:
        return msgspec.json.decode(content)
    except (msgspec.DecodeError, RecursionError) as error:
        remedy = "Name what the command printed with --json."
        raise InvalidValue(field, f"'{path}' is not JSON: {error}.", remedy) from error
