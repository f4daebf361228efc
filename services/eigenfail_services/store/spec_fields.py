"""Fields of a campaign's spec, which is kept as JSON, in questions to the database."""

from typing import Any

from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from eigenfail_services.store.schema import Prose, campaigns


class SpecField(FunctionElement[str]):
    """A field of a campaign's spec as text; objects as JSON."""

    name = "spec_field"
    type = Prose()
    inherit_cache = True


def spec_field(name: str) -> SpecField:
    """The field of a name."""
    return SpecField(campaigns.c.spec, name)


@compiles(SpecField, "sqlite")
def in_sqlite(element: SpecField, compiler: SQLCompiler, **more: Any) -> str:
    """With a path."""
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"json_extract({spec}, '$.' || {name})"


@compiles(SpecField, "postgresql")
def in_postgres(element: SpecField, compiler: SQLCompiler, **more: Any) -> str:
    """With an operator."""
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"(CAST({spec} AS JSON) ->> {name})"
