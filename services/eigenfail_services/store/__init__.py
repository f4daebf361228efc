"""What remembers: SQLite by default, PostgreSQL for production, memory for tests."""

from eigenfail_services.store.memory import MemoryStore
from eigenfail_services.store.opening import open_store

__all__ = ["MemoryStore", "open_store"]
