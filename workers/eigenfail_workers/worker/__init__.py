"""The process around the engine: network and outbox outside, simulator and planner inside."""
