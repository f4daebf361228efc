"""Messages between hub, workers and learners."""
