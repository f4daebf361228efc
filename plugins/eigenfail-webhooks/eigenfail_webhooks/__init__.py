"""Webhooks: signed messages to other systems when campaigns end, modes are found, or gates fail.

A task of the services reads the event log in order and queues messages (`messages`), then sends
them (`dispatcher`). What is queued and sent stands in tables of the plug-in (`tables`).
"""
