"""Webhooks: signed messages to other systems when campaigns end, modes are found, or gates fail.

A task of the services reads the event log in order and queues messages (`messages`), then sends
them (`dispatcher`). Queued and sent messages are stored in tables of the plug-in (`tables`).
"""
