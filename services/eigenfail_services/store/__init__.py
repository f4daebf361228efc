"""The store: campaigns, episodes, analyses, jobs, events and keys in SQLite or PostgreSQL."""
