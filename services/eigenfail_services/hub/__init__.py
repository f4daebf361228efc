"""Hub: where learners and workers meet over ZeroMQ."""
