"""The FastAPI controller: REST, events and the dashboard."""
