"""Common causes and costs of failures, as pure functions over values."""
