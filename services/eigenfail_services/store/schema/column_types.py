"""Kinds of columns for values from anywhere."""

from sqlalchemy import BigInteger, Dialect, Integer, Text, TypeDecorator
from sqlalchemy.types import TypeEngine

LONGEST_PROSE = 4_000

MAX_NUMBER = 2**63 - 1


class Number(TypeDecorator[int]):
    """An id or index from anywhere: one that no column can hold is as good as the largest."""

    impl = BigInteger
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[int]:
        """SQLite counts up by itself only in columns of type INTEGER, which hold 64 bits."""
        return Integer() if dialect.name == "sqlite" else BigInteger()

    def process_bind_param(self, value: int | None, _dialect: Dialect) -> int | None:
        """Within 64 bits."""
        return None if value is None else max(-MAX_NUMBER, min(value, MAX_NUMBER))


class Prose(TypeDecorator[str]):
    """Text from anywhere: a planner's error may hold what no database takes, at any length."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, _dialect: Dialect) -> str | None:
        """Half characters and NUL are replaced, and the end is cut off."""
        if value is None:
            return None
        whole = value[:LONGEST_PROSE].encode(errors="replace").decode()
        return whole.replace("\x00", "�")
