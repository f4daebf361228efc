"""Conversion of frozen values to bytes, text and rows, and back."""

import hashlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

import msgspec
import numpy as np
from sqlalchemy import ColumnElement, Connection, Executable, RowMapping, Table, select

from eigenfail.values import campaign
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.arrays import LITTLE_ENDIAN_FLOAT, Floats, decode_array, encode_array
from eigenfail.values.campaign_spec import CampaignSpec, Priority
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import count_state
from eigenfail.values.measures import Measures
from eigenfail.values.operations import Versions
from eigenfail.values.records import EpisodeRow, FailureCourse, Page, assess, make_failure_course
from eigenfail.values.scene import Scene
from eigenfail.values.shapes import NoiseShape, PerChannel
from eigenfail.worlds import list_channels
from eigenfail_services.resolution import CampaignReferences


class _Course(msgspec.Struct):
    # Of a scene the part that tells how vehicles moved; the rest is not decoded.
    dt_s: float
    vehicles: Floats
    sizes: Floats


_packer = msgspec.msgpack.Encoder(enc_hook=encode_array)
_specs = msgspec.json.Decoder(CampaignSpec)
_estimates = msgspec.json.Decoder(Estimate)
_parts = msgspec.json.Decoder(tuple[campaign.RunPart, ...])
_forms = msgspec.json.Decoder(campaign.EpisodeForm)
_codes = msgspec.json.Decoder(tuple[Versions, ...])
_tags = msgspec.json.Decoder(tuple[str, ...])
_scenes = msgspec.msgpack.Decoder(Scene, dec_hook=decode_array)
_courses = msgspec.msgpack.Decoder(_Course, dec_hook=decode_array)
_analyses = msgspec.msgpack.Decoder(AnalysisResult, dec_hook=decode_array)

COUNTS = dict(
    zip(campaign.Counts.__struct_encode_fields__, campaign.Counts.__struct_fields__, strict=True)
)
"""The attributes of `Counts` by the names of their columns."""

OVERHEAD = campaign.Overhead.__struct_fields__


def to_json(
    value: AnalysisSettings
    | campaign.EpisodeForm
    | CampaignReferences
    | Estimate
    | tuple[campaign.RunPart, ...]
    | tuple[Versions, ...],
) -> str:
    """Return the canonical JSON text of a value: equal values have equal texts."""
    return msgspec.json.encode(value, order="deterministic").decode()


def spec_text(spec: CampaignSpec) -> str:
    """Return the canonical JSON text of a spec without its priority, project and tags.

    These have columns, and do not define a campaign. Fields that were not given are left out, so
    that a new field with a default changes no text, key or hash of existing campaigns.
    """
    fields = msgspec.to_builtins(spec, order="deterministic")
    if spec.parallel is None:
        del fields["parallel"]
    for name in ("priority", "project", "tags"):
        fields.pop(name, None)
    return msgspec.json.encode(fields).decode()


def spec_hash(spec: CampaignSpec) -> str:
    """Return the SHA-256 of a spec, which does not depend on its priority, project and tags."""
    return hashlib.sha256(spec_text(spec).encode()).hexdigest()


def to_settings(text: str) -> AnalysisSettings:
    """Read the settings of an analysis from JSON."""
    return msgspec.json.decode(text, type=AnalysisSettings)


def to_blob(array: Floats) -> bytearray:
    """Return an array as row-major little-endian float32.

    The driver of SQLite binds a bytearray at once; for bytes it would look for an adapter.
    """
    return bytearray(np.ascontiguousarray(array, LITTLE_ENDIAN_FLOAT))


def to_floats(blob: bytes, columns: int) -> Floats:
    """Read an array of shape (rows, columns) from the bytes of `to_blob`."""
    return np.frombuffer(blob, LITTLE_ENDIAN_FLOAT).reshape(-1, columns)


def pack(value: Scene | AnalysisResult) -> bytes:
    """Return a value as MessagePack."""
    return _packer.encode(value)


def to_scene(blob: bytes) -> Scene:
    """Read a scene from MessagePack."""
    return _scenes.decode(blob)


def to_failure_course(index: int, blob: bytes) -> FailureCourse:
    """Read the course of a failure from its scene in MessagePack."""
    course = _courses.decode(blob)
    # An array of MessagePack is a view: without the copy it would keep the whole scene in memory.
    return make_failure_course(index, course.dt_s, course.vehicles, course.sizes.copy())


def to_analysis_result(blob: bytes) -> AnalysisResult:
    """Read the result of an analysis from MessagePack."""
    return _analyses.decode(blob)


def to_tags_text(tags: tuple[str, ...]) -> str | None:
    """Return tags as JSON; None if there are none."""
    return msgspec.json.encode(tags).decode() if tags else None


def to_references(text: str) -> CampaignReferences:
    """Read the references of a campaign from JSON."""
    return msgspec.json.decode(text, type=CampaignReferences)


def to_campaign(found: RowMapping) -> campaign.Campaign:
    """Return a campaign from its row."""
    values: dict[str, Any] = dict(found)
    estimate, parts, code = values.pop("estimate"), values.pop("parts"), values.pop("code")
    values.pop("suite")  # it is in the name
    values.pop("made_by")
    values.pop("planner_version")  # it is in the spec
    values.pop("references")  # they follow from the spec, for who has the plug-ins
    project, tags = values.pop("project"), values.pop("tags")
    priority = Priority(values.pop("priority"))
    spec = msgspec.structs.replace(
        _specs.decode(values.pop("spec")),
        priority=priority,
        project=msgspec.UNSET if project is None else project,
        tags=msgspec.UNSET if tags is None else _tags.decode(tags),
    )
    # What is left in the row after these are the fields of a campaign under their own names.
    spent = [values.pop(name) for name in OVERHEAD]
    counts = campaign.Counts(**{name: values.pop(column) for column, name in COUNTS.items()})
    found_estimate = None if estimate is None else _estimates.decode(estimate)
    return campaign.Campaign(
        spec=spec,
        state=campaign.CampaignState(values.pop("state")),
        counts=counts,
        # An errored episode may hide a failure, which makes the estimate a lower bound. It may have
        # errored after the estimate was stored.
        estimate=found_estimate and found_estimate.bound_below(counts.errored),
        parts=() if parts is None else _parts.decode(parts),
        code=() if code is None else _codes.decode(code),
        overhead=campaign.Overhead(*spent),
        form=_forms.decode(values.pop("form")),
        **values,
    )


def to_row(found: RowMapping, requirements: tuple[float | None, ...] = ()) -> EpisodeRow:
    """Return a line of a list of episodes from its row and its requirements."""
    values: dict[str, Any] = dict(found)
    fault = _fault(values.pop("fault_kind"), values.pop("fault_message"))
    outcome = Outcome(values.pop("outcome"))
    return EpisodeRow(
        outcome=outcome,
        assessed=assess(outcome, _measures(found)),
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        requirements=requirements,
        **values,
    )


class NoiseForm(NamedTuple):
    """The form that the noise of all episodes of a campaign has.

    Attributes:
        shape: how the noise is made from z.
        channels: number of columns of z.
    """

    shape: NoiseShape
    channels: int


def find_noise_form(spec: CampaignSpec) -> NoiseForm:
    """Return the form of the noise of a campaign."""
    return NoiseForm(spec.disturbance.noise_shape, len(list_channels(spec)))


def to_counted_z(blob: bytes, form: NoiseForm) -> Floats:
    """Read z from its bytes, with 0 in place of values without effect."""
    z = to_floats(blob, form.channels)
    return form.shape.drop_uncounted(z) if isinstance(form.shape, PerChannel) else z


@lru_cache(maxsize=64)
def to_noise_form(spec: str) -> NoiseForm:
    """Return the form of a campaign's noise; cached, as results come in hundreds with one spec."""
    return find_noise_form(_specs.decode(spec))


def count_requirements(spec: str | None) -> int:
    """Return how many requirements a campaign names; 0 if it does not exist."""
    return 0 if spec is None else len(_specs.decode(spec).named_requirements)


def _state_width(found: RowMapping, channels: int) -> int:
    rows = found["steps"] * LITTLE_ENDIAN_FLOAT.itemsize
    return len(found["states"]) // rows if rows else count_state(channels)


def to_result(found: RowMapping, scene: bytes | None = None) -> EpisodeResult:
    """Return a result from an episode's row, its blobs, and its campaign's spec."""
    shape, channels = to_noise_form(found["spec"])
    z, sigma = to_floats(found["z"], channels), to_floats(found["sigma"], channels)
    states, importance = found["states"], found["importance"]
    return EpisodeResult(
        index=found["index"],
        seed=found["seed"],
        outcome=Outcome(found["outcome"]),
        steps=found["steps"],
        noise=NoiseTrajectory(z, sigma, shape),
        source=found["source"],
        measures=_measures(found),
        states=None if states is None else to_floats(states, _state_width(found, channels)),
        importance=None if importance is None else to_floats(importance, 1)[:, 0],
        scene=None if scene is None else to_scene(scene),
        fault=_fault(found["fault_kind"], found["fault_message"]),
        wall_s=found["wall_s"],
    )


def _measures(found: RowMapping) -> Measures | None:
    if found["robustness_m"] is None:
        return None
    return Measures(**{name: found[name] for name in Measures.__struct_fields__})


def _fault(kind: str | None, message: str | None) -> EpisodeFault | None:
    return None if kind is None else EpisodeFault(kind, message or "")


Value = TypeVar("Value", bound=msgspec.Struct)

NO_PARSERS: Mapping[str, Callable[[Any], Any]] = MappingProxyType({})


class StructRows(Generic[Value]):
    """Rows of a table that are values of one type.

    A field of the type is read from the column of its name. A struct field without such a column is
    read from the columns of the struct's fields. Other fields keep their defaults.

    Args:
        table: table with a column `id` that rises.
        kind: type of the values.
        parsers: functions that read columns which hold JSON or a packed value, by column.
        without: fields whose columns are not read, such as large ones; they keep their defaults.
    """

    def __init__(
        self,
        table: Table,
        kind: type[Value],
        parsers: Mapping[str, Callable[[Any], Any]] = NO_PARSERS,
        without: tuple[str, ...] = (),
    ) -> None:
        self._table, self._kind, self._parsers = table, kind, parsers
        self._parts: dict[str, tuple[str, ...]] = {}
        self._names: list[str] = []
        for name, hint in get_type_hints(kind).items():
            if name in table.c:
                self._names.append(name)
            elif isinstance(hint, type) and issubclass(hint, msgspec.Struct):
                self._parts[name] = hint.__struct_fields__
                self._names.extend(hint.__struct_fields__)
        self._names = [name for name in self._names if name not in without]
        self.columns = tuple(table.c[name] for name in self._names)

    def read(self, row: RowMapping) -> Value:
        """Return the value in a row with `columns`."""
        values = {name: row[name] for name in self._names}
        # NULL stays None: no parser has to know of it.
        for name, parse in self._parsers.items():
            if values.get(name) is not None:
                values[name] = parse(values[name])
        for name, fields in self._parts.items():
            values[name] = {field: values.pop(field) for field in fields}
        # Converts texts to enumerations, and refuses a row that is no such value.
        return msgspec.convert(values, self._kind)

    def list(self, connection: Connection, statement: Executable) -> tuple[Value, ...]:
        """Return the values of a statement that returns `columns`."""
        return tuple(map(self.read, connection.execute(statement).mappings()))

    def first(self, connection: Connection, statement: Executable) -> Value | None:
        """Return the first value of a statement that returns `columns`, or None."""
        found = connection.execute(statement).mappings().first()
        return None if found is None else self.read(found)

    def page(
        self, connection: Connection, limit: int, before: int | None, *where: ColumnElement[bool]
    ) -> Page[Value]:
        """Return the newest values with ids below `before`, the newest first."""
        number = self._table.c.id
        # One row more than the page has tells whether another page follows.
        query = select(*self.columns).where(*where).order_by(number.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(number < before)
        rows = connection.execute(query).mappings().all()
        items = tuple(map(self.read, rows[:limit]))
        return Page(items, rows[limit - 1]["id"] if len(rows) > limit else None)
