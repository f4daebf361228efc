"""Campaigns: queue, life cycle, supervisor, summaries."""
