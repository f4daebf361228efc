"""Finds the rare failures of driving stacks, groups them into modes, proves and prices them."""

from importlib.metadata import version

__version__ = version("eigenfail")
