"""Campaigns, methods, the learner hub, analysis and the store."""
