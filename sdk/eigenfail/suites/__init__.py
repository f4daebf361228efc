"""Suites: named sets of campaigns, run, resumed and shown as one."""

from eigenfail.suites.suite import MOST_MEMBERS, Member, Suite

__all__ = ["MOST_MEMBERS", "Member", "Suite"]
