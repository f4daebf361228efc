"""The client of an eigenfail service."""

from eigenfail.client.client import Client

__all__ = ["Client"]
