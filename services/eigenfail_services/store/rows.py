"""Values in rows: which columns a struct is made of, and how pages of them are read."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Generic, TypeVar, get_type_hints

import msgspec
from sqlalchemy import ColumnElement, Connection, Executable, RowMapping, Table, select

from eigenfail.values import Page

Value = TypeVar("Value", bound=msgspec.Struct)

NO_PARSERS: Mapping[str, Callable[[Any], Any]] = MappingProxyType({})


class Rows(Generic[Value]):
    """Rows of a table that are values of one type.

    A field of the type is the column of its name. A field that is a struct without such a column
    consists of the columns of its own fields. Other fields keep their defaults.

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
        """Return the value that a row with `columns` is."""
        values = {name: row[name] for name in self._names}
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
